"""Files of figures: PNG, PDF and SVG by their ending, the same ones each time."""

import pytest

from tubeplanner import OptionError
from tubeplanner.views.figure_files import figure_file, new_figure, saved

BEGINS = {".png": b"\x89PNG", ".PDF": b"%PDF", ".svg": b"<?xml"}


def drawn(label="duration of the motion"):
    figure = new_figure(4.0, 3.0)
    axis = figure.add_subplot()
    axis.barh(0, 1.0, hatch="//", label=label)
    axis.set_title(label)
    axis.legend()
    return figure


@pytest.mark.parametrize("ending", BEGINS)
def test_the_ending_says_what_is_written_and_equal_figures_are_equal_files(ending, tmp_path):
    paths = [tmp_path / f"{name}{ending}" for name in ("first", "second")]
    figures = [saved(drawn(), path) for path in paths]
    contents = [path.read_bytes() for path in paths]
    assert contents[0].startswith(BEGINS[ending])
    assert contents[0] == contents[1] == figure_file(figures[0], paths[0])
    assert contents[0] != figure_file(drawn("another"), paths[0])
    assert b"Date" not in contents[0]


def test_text_of_vector_files_stays_text(tmp_path):
    assert ">duration of the motion</text>" in figure_file(drawn(), tmp_path / "a.svg").decode()
    assert b"/FontFile2" in figure_file(drawn(), tmp_path / "a.pdf")  # TrueType, not outlines


def test_another_ending_is_refused_and_nothing_written(tmp_path):
    path = tmp_path / "a.jpg"
    with pytest.raises(
        OptionError, match=r"a\.jpg: name a file that ends in \.png, \.pdf or \.svg"
    ):
        saved(drawn(), path)
    assert not path.exists()
