"""Many bags through one graph, several at a time, each in a process of its own: one that fails stops no other."""

from __future__ import annotations

import subprocess
import sys
from argparse import Namespace
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

from ..bag.reader import Bag
from ..bag.remap import remaps
from ..graph import load_graph
from .console import progress, say


def process_many(options: Namespace) -> int:
    """Writes a bag into the output folder for each bag, under its name; 1 if any failed.

    Raises:
        ValueError: the graph or a renaming is wrong, or two bags would have the same output.
    """
    load_graph(options.graph)
    remaps(options.remap)
    outputs = _outputs(options.bag, options.output)
    options.output.mkdir(parents=True, exist_ok=True)
    seconds = {bag: _seconds(bag) for bag in options.bag}
    failed, done = 0, 0.0
    with progress("process", sum(seconds.values())) as bar, ThreadPoolExecutor(options.jobs) as pool:
        runs = {pool.submit(_run, bag, outputs[bag], options): bag for bag in options.bag}
        for count, run in enumerate(as_completed(runs), 1):
            bag, (code, message) = runs[run], run.result()
            say(f"[{count}/{len(runs)}] {bag}: {message}")
            failed += code != 0
            done += seconds[bag]
            bar(done)
    say(f"{len(runs) - failed} of {len(runs)} bags in {options.output}")
    return int(failed > 0)


def _run(bag: Path, output: Path, options: Namespace) -> tuple[int, str]:
    """Processes a bag; returns the exit code and the program's messages in one line."""
    command = [sys.executable, "-m", "uw_acoustic_loc", "process", bag, "--graph", options.graph, "-o", output]
    command += ["--keep-inputs"] if options.keep_inputs else []
    command += ["--allow-unused"] if options.allow_unused else []
    command += ["--msg-path", options.msg_path] if options.msg_path else []
    for pair in options.remap:
        command += ["--remap", pair]
    done = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
    lines = [line for line in done.stderr.splitlines() if line.strip()]
    if done.returncode != 0:
        last = lines[-1] if lines else "without a message"
        return done.returncode, f"failed with exit code {done.returncode}: {last}"
    return 0, "; ".join(lines)


def _outputs(bags: list[Path], folder: Path) -> dict[Path, Path]:
    outputs: dict[Path, Path] = {}
    for bag in bags:
        output = folder / bag.resolve().name.removesuffix(".mcap").removesuffix(".db3")
        if output in outputs.values():
            raise ValueError(f"{bag}: another bag is named {output.name} too, process it by itself")
        outputs[bag] = output
    return outputs


def _seconds(bag: Path) -> float:
    """Returns the length of a bag in s; 0 for one that will be refused when its turn comes."""
    try:
        first, last = Bag(bag).span()
    except (ValueError, OSError):
        return 0.0
    return (last - first) * 1e-9
