"""Clients of a robot that is up: operator, scripts, oscilloscope, web page."""
