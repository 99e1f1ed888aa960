"""Parts shared by all studies: report folder, index page, figure style, provenance."""
