"""The robot in the browser: a page that shows a robot that is up, or a recording, and controls for the former."""
