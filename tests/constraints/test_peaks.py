import numpy as np
import pytest

from tubeplanner.constraints.peaks import refined_maximum, refined_maximum_of_pieces


def test_a_peak_between_samples_is_found():
    time = np.linspace(0, 1, 21)
    value, when = refined_maximum(
        lambda t: np.cos(40 * (t - 0.3137)), time, np.cos(40 * (time - 0.3137)), band=0.3
    )
    assert value == pytest.approx(1, abs=1e-7)
    assert np.cos(40 * (when - 0.3137)) == value


@pytest.mark.parametrize("shift", [-1e-3, 1e-3])
def test_a_peak_just_beside_a_doubled_sample_is_found_on_either_side(shift):
    """At a breakpoint two samples share a time; rounding must not decide which side is searched."""
    time = np.concatenate([np.linspace(0, 1, 6), np.linspace(1, 2, 6)])

    def function(t):
        return -((t - 1 - shift) ** 2)

    value = function(time)
    value[6] -= 1e-16
    found, when = refined_maximum(function, time, value, band=0.5)
    assert found == pytest.approx(0, abs=1e-9)
    assert when == pytest.approx(1 + shift, abs=1e-4)


def test_the_result_is_never_below_a_sample():
    time = np.linspace(0, 1, 5)
    value = np.array([0.0, 3.0, 0.0, 1.0, 0.0])
    assert refined_maximum(lambda t: np.zeros_like(t), time, value, band=0.1) == (3.0, 0.25)


@pytest.mark.parametrize("gain", [-1e-4, 1e-4])
def test_of_two_peaks_the_higher_one_is_found_with_few_evaluations(gain):
    """Their samples do not tell which it is; a third one, far lower, is soon given up."""
    centres, heights = np.array([0.21, 0.52, 0.83]), np.array([1.0, 1.0 + gain, 0.8])
    evaluated = []

    def function(t):
        evaluated.append(len(t))
        return (heights - 100 * (t[:, None] - centres) ** 2).max(axis=1)

    time = np.linspace(0, 1, 21)
    value, when = refined_maximum(function, time, function(time), band=1.0)
    assert value == pytest.approx(heights.max(), abs=1e-8)
    assert when == pytest.approx(centres[heights.argmax()], abs=1e-4)
    assert evaluated[2] < evaluated[1]


def pieces_of(function, pieces, count=6):
    """Return a function of pieces at the samples that its refinement begins with."""
    share = np.tile(np.linspace(0, 1, count), pieces)
    return function(np.repeat(np.arange(pieces), count), share).reshape(pieces, count)


@pytest.mark.parametrize("centre", [0.004, 0.013, 0.4321, 0.68, 0.987])
@pytest.mark.parametrize("other", [-5.0, 0.99999])
def test_a_peak_beside_a_jump_is_found_whatever_the_next_piece_does(centre, other):
    def function(piece, share):
        return np.where(piece == 1, 1 - 40 * (share - centre) ** 2, other)

    found = refined_maximum_of_pieces(function, pieces_of(function, 3), band=10.0)
    assert found == pytest.approx(1.0, abs=1e-7)


def test_a_peak_at_an_end_is_the_sample_there_and_soon_done_with():
    """Of a hundred pieces, each straight: nothing rises above its ends."""
    evaluated = []

    def function(piece, share):
        evaluated.append(len(piece))
        return share * np.where(piece % 2, 1.0, 0.5) - 1e-3 * piece

    value = pieces_of(function, 100)
    assert refined_maximum_of_pieces(function, value, band=1.0) == value.max()
    assert evaluated[2:] == [9] * 5


def test_of_many_peaks_the_highest_is_found():
    """Their samples hardly differ; which is the highest shows only between them."""
    centres = np.random.default_rng(0).uniform(0.3, 0.7, 200)

    def function(piece, share):
        return -((share - centres[piece]) ** 2) + 1e-3 * (piece == 137)

    found = refined_maximum_of_pieces(function, pieces_of(function, 200), band=1.0)
    assert found == pytest.approx(1e-3, abs=1e-8)


def test_where_nothing_limits_nothing_is_refined():
    value = np.full((2, 4), -np.inf)
    assert refined_maximum_of_pieces(lambda *_: np.zeros(1), value, band=1.0) == -np.inf
