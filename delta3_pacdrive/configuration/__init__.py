"""Strict readers of user files; every error is reported with its position."""
