"""Tables of measurements: CSV, Parquet and MATLAB files, their columns and units."""
