"""A process that works with the sources of a checkout, so that two can be compared in turns."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent.parent
# What drivers begin with, for either checkout's package, whether it makes motions smooth or not:
# durations are compared of the shortest ones.
SHORTEST = """
from tubeplanner import PlanOptions
SHORTEST = PlanOptions(slack=0.0) if hasattr(PlanOptions, "slack") else PlanOptions()
"""


class Checkout:
    """A process that answers questions, each a line of JSON, with a checkout's own package."""

    def __init__(self, folder: Path, driver: str, *arguments: str) -> None:
        """Start it.

        Args:
            folder: The checkout.
            driver: Its program: reads questions from its input and prints an answer to each.
            arguments: Of the program.
        """
        variables = {"PYTHONPATH": str(folder / "src"), "OPENBLAS_NUM_THREADS": "1"}
        self._folder = folder
        self._process = subprocess.Popen(
            [sys.executable, "-c", driver, *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=os.environ | variables,
            text=True,
        )

    def ask(self, question: Any) -> Any:
        """Return the answer to a question; end the program if there is none."""
        asked, answers = self._process.stdin, self._process.stdout
        assert asked is not None and answers is not None
        asked.write(json.dumps(question) + "\n")
        asked.flush()
        line = answers.readline()
        if not line:
            raise SystemExit(f"{self._folder}: the process has ended, asked {question}")
        return json.loads(line)
