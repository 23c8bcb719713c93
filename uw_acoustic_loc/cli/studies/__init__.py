"""One module per study that `uwloc reproduce` can run; `cli.reproduce.Study` says what it must offer."""
