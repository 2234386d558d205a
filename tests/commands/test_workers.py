"""What plans many problems for a command: this machine or a cluster, never both."""

import pytest

from tubeplanner.commands.workers import workers_of
from tubeplanner.errors import OptionError
from tubeplanner.many.worker_processes import WorkerProcesses


def test_this_machine_plans_in_as_many_processes_as_asked():
    with workers_of(3) as workers:
        assert isinstance(workers, WorkerProcesses) and workers.count == 3


def test_a_cluster_has_its_own_processes():
    both = workers_of(2, "tcp://127.0.0.1:1")
    with pytest.raises(OptionError, match="--processes is for this machine, --scheduler for a"):
        both.__enter__()


def test_a_study_says_that_there_is_no_scheduler(run, tmp_path):
    table = tmp_path / "t.csv"
    study = "example:ur5/tolerance_and_payload"
    status, _, err = run("study", study, "-o", table, "--scheduler", "tcp://127.0.0.1:1")
    assert status == 2
    assert "there is no Dask scheduler at tcp://127.0.0.1:1" in err
    assert not table.exists()
