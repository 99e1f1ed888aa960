"""The robot in the browser: a page with a running robot and its controls, or with a recording."""
