"""Bad input of every command: named in one line or one object, status 2, nothing written."""

import json
import shlex

import pytest
from stored_trajectories import REFINEMENT, stored_path

POST, LINE = "example:two_link/around_a_post", "example:two_link/paper_1_30mm"
STUDY = "example:ur5/tolerance_and_payload"
RUNS = f"simulate {POST} {stored_path('two_link/around_a_post', REFINEMENT)}"
PLACE = f"place {POST} --region=-0.3,-0.3,0,0"
VARY = f"sweep {LINE} --vary"
FIELDS = {
    *("status", "message", "where", "duration", "phase1_duration", "planning_time"),
    *("loading_time", "certificate_time", "stopped_by", "certificate"),
}


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("plan", "Missing argument 'PROBLEM'"),
        (f"paln {POST}", "No such command 'paln'"),
        ("plan example:ur5/over", "unknown bundled problem 'ur5/over'"),
        ("plan nowhere.yaml", "problem file nowhere.yaml does not exist"),
        (f"plan {POST} --method magic", "unknown method 'magic'"),
        (f"plan {POST} --rate 0", "rate is 0 Hz; it must be > 0 and finite"),
        (f"plan {POST} --time-limit -1", "time_limit is -1 s"),
        (f"plan {POST} --spped 1", "No such option"),
        (f"plan {POST} -o /nowhere/t.json", "the folder /nowhere does not exist"),
        (f"plan {POST} --plot x.jpg", "name a file that ends in .png, .pdf or .svg"),
        (f"plan {POST} -o t.json --html t.txt", "name a file that ends in .html"),
        (f"plan {POST} -o a --csv a", "is the same file as a; choose another"),
        (f"check {POST} nowhere.json", "nowhere.json cannot be read: No such file"),
        (f"check {POST} x.json --tolerance small", "'small' is not ABS or ABS,REL"),
        (f"plot {POST} t.json -o t.jpg", "-o t.jpg: name a file that ends in .png"),
        (f"view {POST} gone.json", "gone.json"),
        (f"view {POST} --html nowhere/page.html", "does not exist"),
        (f"sweep {LINE}", "either --radius or --radius-scale"),
        (f"sweep {LINE} --radius '1;2'", "--radius '1;2' is no list of numbers"),
        (f"sweep {LINE} --radius 0", "radius is 0; it must be > 0"),
        (f"sweep {LINE} --radius 1 -o t.txt", "ends in .csv or .json"),
        (f"{VARY} tube.radius=1 --radius 1", "either --radius or --radius-scale or --vary"),
        (
            f"{VARY} tube.radius=1 --vary clearance=0",
            "--vary clearance=0: a sweep varies one field; leave out the others",
        ),
        (f"{VARY} obstacles.post.sphere=1", "obstacles is not given; give it as a whole"),
        (f"{VARY} tube.radius", "--vary 'tube.radius': give FIELD.PATH=V1,V2,..."),
        (f"{VARY} tube.radius=1 --set tube.radius=2", "both varied and changed"),
        (f"{VARY} objective.slack=0 --slack 0", "slack is given; leave out one of them"),
        (f"compare {LINE} --methods bobrow", "unknown method 'bobrow'"),
        (f"compare {LINE} -o t.txt", "ends in .csv or .json"),
        (f"compare {LINE} --trajectories nowhere/else", "the folder"),
        (f"measure {POST} --max-radius 0", "max_radius is 0 m; it must be > 0"),
        (f"measure {POST} --configurations -o x.yaml", "compares and writes no file"),
        (f"study {STUDY} -o t.txt", "ends in .csv or .json"),
        (f"study {STUDY} --plot t.jpg", "ends in .png"),
        (f"study {STUDY} --processes 0", "'--processes': 0 is not in the range x>=1"),
        (f"explain {POST} --set tube=null", "tube is required; `tubeplanner route` finds one"),
        (f"explain {POST} --set robot.tool_frame=hnd", "unknown tool_frame 'hnd' (did you mean"),
        (f"explain {POST} --quality bst", "unknown quality 'bst' (did you mean 'best'?)"),
        (f"explain {POST} --time-limit nan", "time_limit is nan s; it must be > 0"),
        (PLACE, "stands_on is required where there are obstacles (post)"),
        (f"{PLACE} --stands-on pst", "unknown obstacle 'pst'"),
        (f"place {POST}", "Missing option '--region'"),
        (f"place {POST} --region 0,1,a,2", "--region '0,1,a,2' is no list of numbers"),
        (f"{PLACE} -o best.txt", "-o best.txt: name a file that ends in .yaml"),
        (f"{PLACE} --plot map.jpg", "--plot map.jpg: name a file that ends in .png"),
        (f"{RUNS} --mass 2", "robustness.mass is 2; give a number from 0 to 0.9"),
        (f"{RUNS} --controller lqr", "unknown controller 'lqr'"),
        (f"{RUNS} --runs 0", "runs is 0"),
        # Before any work, which would find that there is no problem.
        ("simulate example:no/such no.json --plot runs.jpg", "name a file that ends in .png"),
        (
            "simulate example:no/such no.json --html runs.png",
            "--html runs.png: name a file",
        ),
        ("simulate example:no/such no.json --plot nowhere/a.png", "nowhere does not exist"),
        ("init example:two_link -o a.json", "a.json"),
        ("info example:nothing", "nothing"),
        ("info nothing.urdf", "nothing.urdf"),
        ("links nothing.yaml", "nothing.yaml"),
    ],
)
def test_bad_input_is_named_and_exits_with_2(line, message, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, out, err = run(*shlex.split(line))
    assert (status, out) == (2, "")
    assert message in err
    status, out, _ = run(*shlex.split(line), "--json")
    fields = json.loads(out)
    assert (status, fields["status"]) == (2, "bad_input")
    assert message in fields["message"]
    assert set(fields) >= FIELDS
    assert list(tmp_path.iterdir()) == []
