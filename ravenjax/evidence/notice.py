"""What evidence is not: the sentence that every file carries which can."""

from __future__ import annotations

NOTICE = (
    "This is output of a simulation. It makes no claim of conformity with any standard, regulation"
    " or guidance, it is no risk assessment, and it says nothing of how often a fault occurs."
)
