"""Makes bags/harbour again: 20 s of the harbour scenario's sensors and truth, the hydrophones for the first 4 s only.

    python bags/make_harbour.py bags/harbour

What else lies in the folder (README, expectation) is kept.
"""

from __future__ import annotations

import dataclasses
import shutil
import sys
import tempfile
from pathlib import Path

from uw_acoustic_loc.bag.about import about_scenario
from uw_acoustic_loc.bag.reader import Bag
from uw_acoustic_loc.bag.simulate import simulate
from uw_acoustic_loc.bag.writer import BagWriter
from uw_acoustic_loc.resources import resource
from uw_acoustic_loc.sim.scenario import load_scenario

DURATION, HEARD = 20.0, 4.0  # s
SEED = 20
SAMPLES = "/auv1/hydrophones/samples"


def main(out: Path) -> None:
    """Simulates into a temporary bag and copies what is wanted of it."""
    scenario = load_scenario(resource("config/harbour/scenario.yaml"))
    scenario = dataclasses.replace(scenario, duration=DURATION, seed=SEED)
    until_ns = scenario.start_ns + round(HEARD * 1e9)
    with tempfile.TemporaryDirectory() as folder:
        simulate(scenario, Path(folder, "whole"), lambda _t_ns: None)
        bag = Bag(Path(folder, "whole"))
        about = {"made_by": f"make_harbour.py, {SAMPLES} cut after {HEARD:g} s", **about_scenario(scenario)}
        made = Path(folder, out.name)
        with BagWriter(made, about) as writer:
            for topic in bag.topics.values():
                writer.add_topic(topic.name, topic.msgtype, topic.latched)
            for record in bag.records():
                if record.topic != SAMPLES or record.t_ns <= until_ns:
                    writer.write(record.topic, record.t_ns, record.data)
        for file in made.iterdir():
            out.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, out / file.name)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]))
