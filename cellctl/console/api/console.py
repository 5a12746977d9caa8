"""The console itself: its version, its runs folder, the audit log."""

from __future__ import annotations

import asyncio
from typing import Annotated, Any

from fastapi import APIRouter, Query
from pydantic import BaseModel, Field

from cellctl.console.shared import console
from cellctl.version import __version__

router = APIRouter(prefix="/api", tags=["console"])


class About(BaseModel):
    """This console."""

    version: str = Field(description="Version of cellctl")
    runs: str = Field(description="Folder of the runs")
    cell: str | None = Field(description="Cell file that the console was started with")


@router.get("/console")
async def about() -> About:
    """Version, runs folder and cell of this console."""
    settings = console().settings
    return About(version=__version__, runs=str(settings.runs), cell=str(settings.cell) if settings.cell else None)


@router.get("/audit")
async def audit(
    last: Annotated[int, Query(ge=1, le=10_000, description="Number of commands")] = 200,
) -> list[dict[str, Any]]:
    """The newest commands that this folder's consoles took, newest first: who, when, what, outcome."""
    return await asyncio.to_thread(console().audit.read, last)
