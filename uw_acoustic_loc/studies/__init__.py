"""The papers' experiments, theirs beside ours."""
