"""The last few results of a costly function."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import Generic, TypeVar

Result = TypeVar("Result")


@dataclass(frozen=True)
class RecentResults(Generic[Result]):
    """Results by what they were computed from; of more than `most` the one that was not asked for longest goes.

    Parameters
    ----------
    most : int
    """

    most: int
    known: OrderedDict[Hashable, Result] = field(default_factory=OrderedDict, compare=False, repr=False)

    def recalled(self, key: Hashable, compute: Callable[[], Result]) -> Result:
        """The result of a key, computed where it is not known.

        Parameters
        ----------
        key : hashable
            All that the result depends on.
        compute : callable
            Takes nothing, gives the result; what it raises is raised.

        Returns
        -------
        Result
            The very object that is kept: nobody changes it.
        """
        if key not in self.known:
            self.known[key] = compute()
        self.known.move_to_end(key)
        if len(self.known) > self.most:
            self.known.popitem(last=False)
        return self.known[key]
