"""Verification of running robots: fault catalogue, soak test and their invariants."""
