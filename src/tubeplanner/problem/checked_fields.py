"""What files hold, checked against the models of their formats."""

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from pydantic import ValidationError

from tubeplanner.errors import ProblemError
from tubeplanner.problem.field_types import Section
from tubeplanner.problem.problem_faults import fault_steps, first_fault

_Fields = TypeVar("_Fields", bound=Section)


def check_fields(
    model: type[_Fields],
    data: object,
    what: str,
    source: str,
    source_of: Callable[[Any, Sequence[int | str]], str] | None,
) -> _Fields:
    """Check the shape of nested dictionaries and lists against a model.

    Args:
        model: What they must match.
        data: What a file holds.
        what: What it must be, if it is no map.
        source: What messages call it.
        source_of: From the data, and the keys and indices that lead to a value: what messages call
            the file that has it; None: all is from one.

    Raises:
        ProblemError: A key is unknown, a value has the wrong type. The message names the field.
    """
    if not isinstance(data, dict):
        raise ProblemError(f"{source}: {what}")
    try:
        return model.model_validate(data)
    except ValidationError as error:
        fault = first_fault(data, error, model)
        called = source if source_of is None else source_of(data, fault_steps(data, error))
        raise ProblemError(f"{called}: {fault}") from None
