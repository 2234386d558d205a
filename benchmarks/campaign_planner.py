"""A process that plans, begun anew when it dies or takes too long; for `campaign.py`."""

import atexit
import json
import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from select import select
from typing import Any

SCRIPT = Path(__file__).with_name("campaign_plan.py")


class PlannerProcess:
    """Plans files one after the other in a process of its own."""

    def __init__(self) -> None:
        """Begin no process yet; one that was begun ends with this one at the latest."""
        self._process: subprocess.Popen[str] | None = None
        atexit.register(self.end)

    def plan(self, asked: dict[str, Any], timeout: float) -> dict[str, Any]:
        """Return what `campaign_plan.py` answers, or status crash or timeout.

        Args:
            asked: What it reads.
            timeout: After how long the process is ended [s].
        """
        process = self._process = self._process or _begun()
        assert process.stdin is not None and process.stdout is not None
        try:
            process.stdin.write(json.dumps(asked) + "\n")
            process.stdin.flush()
            if not select([process.stdout], [], [], timeout)[0]:
                self.end()
                return {"status": "timeout", "message": f"ended after {timeout:g} s"}
            line = process.stdout.readline()
        except BrokenPipeError:
            line = ""
        if not line:
            code = process.wait()
            self.end()
            return {"status": "crash", "message": f"the process ended with {code}"}
        return json.loads(line)

    def end(self) -> None:
        """End the process; the next plan begins another."""
        if self._process is not None:
            with suppress(BrokenPipeError), self._process:  # what it did not read
                self._process.kill()
        self._process = None


def _begun() -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, str(SCRIPT)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
        text=True,
    )
