"""The API of one's own printers: describe, measure, learn, mend, prove."""

from fastapi import APIRouter

from printmend.studio.api import PROBLEMS

router = APIRouter(prefix="/api/printers", responses=PROBLEMS, tags=["printers"])
