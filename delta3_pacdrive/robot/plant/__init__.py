"""Plant: three motors with brakes and gears, and the coupled arms (thesis 4.7 to 4.9, 8.2, 8.3)."""
