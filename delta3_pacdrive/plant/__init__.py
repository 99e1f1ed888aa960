"""The machine: three motors with brakes and gears, and the arms that couple them (thesis 4.7 to 4.9, 8.2, 8.3)."""
