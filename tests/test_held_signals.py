import signal
import threading

import pytest

from tubeplanner.held_signals import signals_held


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_comes_at_the_end(number):
    came = []
    before = signal.signal(number, lambda *_: came.append("came"))
    try:
        with signals_held():
            signal.raise_signal(number)
            came.append("went on")
        assert came == ["went on", "came"]
        signal.raise_signal(number)
        assert came == ["went on", "came", "came"]
    finally:
        signal.signal(number, before)


def test_ctrl_c_goes_before_what_went_wrong():
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt), signals_held():
            signal.raise_signal(signal.SIGINT)
            raise ValueError("a full disk")
    finally:
        signal.signal(signal.SIGINT, before)


def test_another_thread_holds_nothing_and_is_not_in_the_way():
    done = []

    def work():
        with signals_held():
            done.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert done == [signal.getsignal(signal.SIGINT)]
