"""Topics, services, quality of service, encoding and discovery."""
