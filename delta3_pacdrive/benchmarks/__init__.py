"""What things cost, each beside what it is measured against."""
