"""The machine: motors and mechanics (plant), MC-4 drives, SERCOS bus, and faults that can be injected."""
