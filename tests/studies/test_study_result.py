"""The table of a study: CSV and JSON say the same."""

import csv
import io
import json

from studied import EFFORT, RADIUS, small_study, some_result
from tubeplanner.studies.study_result import StudyResult


def test_csv_and_json_say_the_same():
    values = {RADIUS: [0.02, "x2", [0.01]], EFFORT: [1, float("inf")]}
    result = some_result(values, blocked=lambda each: each[EFFORT] != 1)
    table = list(csv.DictReader(io.StringIO(result.csv())))
    fields = json.loads(json.dumps(result.as_dict(), allow_nan=False))
    assert (fields["study"], fields["points"]) == ("small", 6)
    assert fields["counts"] == {"success": 3, "tube_blocked": 3}
    assert [line[RADIUS] for line in table] == ["0.02", "0.02", "x2", "x2", "[0.01]", "[0.01]"]
    assert [line[EFFORT] for line in table] == ["1", ".inf"] * 3
    for line, row in zip(table, fields["rows"], strict=True):
        assert int(line["point"]) == row["point"]
        assert line["status"] == row["status"]
        assert line["message"] == row["message"]
        assert (float(line["duration"]) if line["duration"] else None) == row["duration"]
    assert list(table[0])[:5] == ["point", RADIUS, EFFORT, "status", "duration"]


def test_notes_and_places_are_written_as_text():
    result = some_result({RADIUS: [0.02]}, fields={"notes": ("one", "two")})
    (line,) = csv.DictReader(io.StringIO(result.csv()))
    assert (line["notes"], line["where"]) == ("one; two", "")


def test_the_shortest_and_whether_there_is_any():
    result = some_result({RADIUS: [0.02, 0.03, 0.04]}, blocked=lambda each: each[RADIUS] < 0.03)
    assert result.succeeded
    assert result.shortest.values == {RADIUS: 0.03}
    nothing = some_result({RADIUS: [0.02]}, blocked=lambda _: True)
    assert not nothing.succeeded
    assert nothing.shortest is None
    assert StudyResult(small_study(), ()).counts == {}
