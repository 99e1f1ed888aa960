"""Files that people write: one reader that knows where every value stands, and tells all that is wrong with them."""
