"""The MC-4 servo drive: cascade, encoder, observer, supervision (thesis 7.1, 8.1)."""
