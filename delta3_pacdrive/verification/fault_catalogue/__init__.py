"""Every fault in every state on a robot that is up, what each has to lead to, and whether it is overcome."""
