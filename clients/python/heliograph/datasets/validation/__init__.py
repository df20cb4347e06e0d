"""validate(): a data set against its format. Shares no code with the writers."""

from __future__ import annotations

from .report import Fault, Report
from .run import validate
from .table import FORMATS

__all__ = ["FORMATS", "Fault", "Report", "validate"]
