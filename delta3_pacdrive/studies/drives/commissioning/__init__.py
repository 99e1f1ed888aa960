"""Commissioning of a running robot: measured loops, gains from them, inertia and friction of the axes at one pose."""
