"""Lines: belts that run through several robots, parts handed on, rules of allocation, a shift without a bus."""
