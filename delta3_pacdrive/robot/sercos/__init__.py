"""SERCOS: bus time, phases, control and status words, increments (thesis 2.2.3, 8.1)."""
