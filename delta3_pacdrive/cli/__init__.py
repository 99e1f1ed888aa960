"""The command line ``delta3``."""
