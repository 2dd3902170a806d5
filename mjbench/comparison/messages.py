"""What the children of a comparison send back, and the files that they write.

Frozen dataclasses, pickled from process to process (see `mjbench.host.isolate`). A variant is
named by its position in the plan.
"""

from dataclasses import dataclass
from pathlib import Path

from mjbench.status import Status


@dataclass(frozen=True)
class ModelFiles:
    """Where a model and its workload are saved, so that other processes do the same work.

    Attributes:
      workload: a pickled `PortableWorkload`, with its final states, for the launches of a race.
    """

    model: Path
    workload: Path
    accelerated: Path

    @classmethod
    def in_folder(cls, folder: Path) -> "ModelFiles":
        names = ("model.mjb", "workload.pickle", "accelerated.pickle")
        return cls(*(folder / name for name in names))


@dataclass(frozen=True)
class AgreementReport:
    """Whether a variant does what the reference run does, so that it may be timed.

    Attributes:
      agrees: None where it was not compared.
      agreement: the rule that was held, or the first difference.
    """

    position: int
    status: Status
    detail: str = ""
    agrees: bool | None = None
    agreement: str = ""
    snippet: str = ""
