"""What a family's manual leaves open, tried on the real drive."""

from __future__ import annotations

from collections.abc import Sequence

from rs485bus.bench.verify.question import Question
from rs485bus.errors import NotSupported
from rs485bus.plant.family import Family


def questions_of(family: Family) -> Sequence[Question]:
    """The questions that there are for a family.

    Raises:
        NotSupported: there are none.
    """
    if family.questions is not None:
        found: Sequence[Question] = family.questions()
        return found
    match family.name:
        case "mks":
            from rs485bus.bench.verify import mks

            return mks.QUESTIONS
        case "tlr":
            from rs485bus.bench.verify import tlr

            return tlr.QUESTIONS
        case "zlac":
            from rs485bus.bench.verify import zlac

            return zlac.QUESTIONS
    raise NotSupported(f"There are no questions for the family {family.name}: nothing of it is known to be open.")
