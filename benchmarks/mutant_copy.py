"""Running some tests in a copy of a checkout, each time in a fork that knows its libraries."""

import os
import resource
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing import get_context
from pathlib import Path

import pytest

PASSED, NO_TESTS = 0, 5  # pytest's exit statuses
TIMEOUT, CRASH = "timeout", "crash"
_NOT_COPIED = (".git", ".venv", "output", ".*_cache", ".hypothesis", ".coverage*")
_PACKAGE_OUTPUT = Path("src/tubeplanner/output")  # no results, though of their folder's name
# Tests run in forks of a process that has the libraries, but nothing of the package.
_LIBRARIES = (
    *("click", "coal", "fcl", "hypothesis", "lazy_loader", "numpy.polynomial"),
    *("pinocchio", "piqp", "pydantic", "pytest", "ruamel.yaml", "scipy.interpolate"),
    *("scipy.optimize", "scipy.sparse.linalg", "scipy.spatial.transform", "scipy.special"),
    *("toppra", "trimesh", "yourdfpy"),
)
_COVERS = Path("output/test-covers")  # of links and solids, which tests keep from run to run
_WAITS = 3  # other processes, and what a test waits for
_LOG, _FAILED = "mutant.log", "mutant.failed"
_CONTEXT = get_context("forkserver")
_CONTEXT.set_forkserver_preload(list(_LIBRARIES))


class Copy:
    """A copy of a checkout in which one module at a time is another."""

    def __init__(self, folder: Path, checkout: Path) -> None:
        self._folder, self._known_covers = folder, checkout / _COVERS
        shutil.copytree(checkout, folder, ignore=shutil.ignore_patterns(*_NOT_COPIED))
        shutil.copytree(checkout / _PACKAGE_OUTPUT, folder / _PACKAGE_OUTPUT)
        # Compiled here, where it is not: what is read from then on is the module that changes.
        compiling = [sys.executable, "-m", "compileall", "-q", "src", "tests"]
        subprocess.run(compiling, cwd=folder, check=True)
        self._renew_covers()

    @property
    def log(self) -> str:
        """What the last tests printed."""
        return (self._folder / _LOG).read_text()

    @contextmanager
    def changed(self, module: str, text: str) -> Iterator[None]:
        """Give a module of the package another text for a while."""
        path = self._folder / "src" / "tubeplanner" / module
        original = path.read_text()
        for compiled in (path.parent / "__pycache__").glob(f"{path.stem}.*.pyc"):
            compiled.unlink()
        path.write_text(text)
        try:
            yield
        finally:
            path.write_text(original)
            self._renew_covers()

    def _renew_covers(self) -> None:
        """Take the checkout's covers again: a mutant may have kept wrong ones."""
        shutil.rmtree(self._folder / _COVERS, ignore_errors=True)
        if self._known_covers.is_dir():
            shutil.copytree(self._known_covers, self._folder / _COVERS)

    def failure(self, tests: list[str], time_limit: float) -> str:
        """Return the first test that fails, `TIMEOUT` or `CRASH`; "" if all pass.

        Args:
            tests: Their names, in their order.
            time_limit: Seconds of the processor; of a busy machine, `_WAITS` times as many.

        Raises:
            RuntimeError: None of the tests is there.
        """
        (self._folder / _FAILED).write_text("")
        process = _CONTEXT.Process(target=_run_tests, args=(self._folder, tests, time_limit))
        process.start()
        process.join(_WAITS * time_limit)
        is_late = process.exitcode in (None, -signal.SIGXCPU)
        with suppress(ProcessLookupError):  # with the processes that tests have left
            os.killpg(process.pid or 0, signal.SIGKILL)
        process.join()
        if is_late:
            return TIMEOUT
        if process.exitcode == NO_TESTS:
            raise RuntimeError(f"not one of {len(tests)} tests is there, so {tests[0]}\n{self.log}")
        if process.exitcode == PASSED:
            return ""
        return (self._folder / _FAILED).read_text() or CRASH


class _Selection:
    """A plugin of pytest that runs some tests in their order and writes down what fails."""

    def __init__(self, tests: list[str]) -> None:
        self._ranks = {test: rank for rank, test in enumerate(tests)}

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        selected = [item for item in items if item.nodeid in self._ranks]
        items[:] = sorted(selected, key=lambda item: self._ranks[item.nodeid])

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self._note(report)

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        self._note(report)

    def _note(self, report: pytest.TestReport | pytest.CollectReport) -> None:
        if report.failed:
            Path(_FAILED).write_text(report.nodeid)


def _run_tests(folder: Path, tests: list[str], time_limit: float) -> None:
    """Run tests of a copy of a checkout; end with pytest's exit status."""
    os.setsid()  # a group of its own, which can be ended as one
    resource.setrlimit(resource.RLIMIT_CPU, (int(time_limit) + 1, int(time_limit) + 2))
    sys.dont_write_bytecode = True
    os.chdir(folder)
    os.environ |= {
        "PYTHONPATH": str(folder / "src"),
        "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    sys.path.insert(0, str(folder / "src"))
    log = os.open(_LOG, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(log, 1)
    os.dup2(log, 2)
    # What is asserted counts, not how a failure reads.
    options = ["-x", "-q", "-p", "no:cacheprovider", "-p", "pytest_timeout", "--assert=plain"]
    files = dict.fromkeys(test.partition("::")[0] for test in tests)
    arguments = [*options, f"--basetemp={folder / 'mutant.tmp'}", *files]
    status = pytest.main(arguments, plugins=[_Selection(tests)])
    os._exit(int(status))
