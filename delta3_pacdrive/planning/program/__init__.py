"""Motion programs: their statements as values, and the readers of program files."""
