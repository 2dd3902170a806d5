"""What numbers and versions of a record must be; a run file with others is refused.

The bounds are upheld where msgspec reads a file. Where it is missing, as in the environments of old
releases, no file is read, and they are annotations alone.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

from mjbench.status import Status

if TYPE_CHECKING:
    from msgspec import Meta
else:
    try:
        from msgspec import Meta
    except ImportError:

        def Meta(**bounds: Any) -> Any:  # noqa: N802
            """Return bounds that nothing upholds."""
            return tuple(bounds.items())


_Item = TypeVar("_Item")
# So large that nothing derived from two of them overflows.
_LARGEST_INT, _LARGEST_FLOAT = 10**15, 1e12

PositiveInt = Annotated[int, Meta(ge=1, le=_LARGEST_INT)]
NonNegativeInt = Annotated[int, Meta(ge=0, le=_LARGEST_INT)]
PositiveFloat = Annotated[float, Meta(gt=0, le=_LARGEST_FLOAT)]
NonNegativeFloat = Annotated[float, Meta(ge=0, le=_LARGEST_FLOAT)]
# Shorter steps of a simulation do not change its state.
Timestep = Annotated[float, Meta(ge=1e-15, le=_LARGEST_FLOAT)]
# No clock resolves less, and ratios of two of these do not overflow.
Nanoseconds = Annotated[float, Meta(ge=1e-3, le=_LARGEST_FLOAT)]
# What may be far off, such as the states and energies of a simulation that diverges; products of
# two do not overflow.
AnyFloat = Annotated[float, Meta(ge=-1e100, le=1e100)]
AnyInt = Annotated[int, Meta(ge=-_LARGEST_INT, le=_LARGEST_INT)]
# A seed, the number of a thread, or nanoseconds of a clock that began long ago.
Int64 = Annotated[int, Meta(ge=0, le=2**63 - 1)]
# A part of a whole: a difference of noisy times may be a little below 0, or above 1.
Share = Annotated[float, Meta(ge=-10, le=10)]
# So short that it cannot decompress to more than about 64 MiB.
CompressedText = Annotated[str, Meta(max_length=2**16)]
# Of the baseline, and of the candidate.
TwoOf = Annotated[Sequence[_Item], Meta(min_length=2, max_length=2)]
# A release of MuJoCo: pages and files are named after it.
Version = Annotated[
    str,
    Meta(
        pattern=r"^[0-9]+(\.[0-9]+)+([-.]?(a|b|c|rc|alpha|beta|pre|dev|post)[-.]?[0-9]*)*"
        r"(\+[0-9A-Za-z]+([-_.][0-9]+)*)?$",
        max_length=64,
    ),
]
# No two targets differ by more than e to the power of this.
LogRatio = Annotated[float, Meta(ge=-50, le=50)]


def check_measured(record: Any, *names: str) -> None:
    """Check that a record whose status is `ok` has what is None in others.

    Raises:
      ValueError: one of them is None.
    """
    for name in names:
        if record.status == Status.OK and getattr(record, name) is None:
            raise ValueError(f"its status is ok, but it has no `{name}`")
