"""Results with one table, from which data frame, dataset and the view in a notebook follow."""

from abc import abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar, TypeVar, overload

from compact.report.tables import TableSpec

if TYPE_CHECKING:
    import pandas
    import xarray

Item = TypeVar("Item")


class Tabular:
    """Result with a table in SI units."""

    _index: ClassVar[str | None] = None  # column that becomes the index of the data frame

    @property
    @abstractmethod
    def table(self) -> TableSpec:
        """Table of the result, with its quantities."""

    def to_dataframe(self) -> "pandas.DataFrame":
        """Return the table in SI units; `attrs["units"]` maps each column to its unit."""
        return self.table.to_dataframe(self._index)

    def _repr_html_(self) -> str:
        return self.table.to_html()


class TabularOverSpeed(Tabular):
    """Result with a table over the speed."""

    _index = "speed"

    @property
    @abstractmethod
    def _attributes(self) -> dict[str, str]:
        """Attributes of the dataset."""

    def to_xarray(self) -> "xarray.Dataset":
        """Return the table as a dataset over the speed [m/s], with units."""
        return self.table.to_xarray("speed", self._attributes)


class Items(Tabular, Sequence[Item]):
    """Result that is a sequence of `items`."""

    @property
    @abstractmethod
    def items(self) -> tuple[Item, ...]:
        """Items of the sequence."""

    @overload
    def __getitem__(self, index: int) -> Item: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[Item]: ...

    def __getitem__(self, index: int | slice) -> Item | Sequence[Item]:
        return self.items[index]

    def __len__(self) -> int:
        return len(self.items)
