"""Lines of several robots at belts: allocation rules, and simulation of a shift without a bus."""
