"""Parameter estimation (chapter 9): what the signals of a robot tell about P1, P3 and P4, and how well."""
