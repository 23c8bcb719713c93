"""One module per command: HELP, `add` for its arguments, `run` for what it does. Heavy imports stand inside `run`."""
