"""Pictures that go from frame to frame with their truth, and that can be taken again at another moment if rendered."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

from pipeline.frame import Frame, Picture, Renderer, Truth

Retake: TypeAlias = Callable[[int], tuple[Picture, int]]
"""From how much later a picture is taken, in ns, to that picture and the moment it shows."""

Paint: TypeAlias = Callable[[Picture], Picture]


@dataclass(frozen=True, slots=True)
class RetakableFrame(Frame):
    """A rendered frame on its way through the faults.

    `retake` goes where the picture goes and takes with it what earlier faults did to it: a picture that was turned is
    turned at every other moment, too, and one that stands still stays.
    """

    retake: Retake | None = None


def retakable(frame: Frame, renderer: Renderer) -> Frame:
    """The frame as its source delivered it, with the means to render its picture anew; its truth must be known."""
    assert frame.truth is not None
    shown_ns = frame.truth.shown_ns

    def retake(later_ns: int) -> tuple[Picture, int]:
        return renderer.picture_at(frame.camera, shown_ns + later_ns), shown_ns + later_ns

    fields = {name: getattr(frame, name) for name in Frame.__dataclass_fields__}
    return RetakableFrame(**fields, retake=retake)


def plain(frame: Frame) -> Frame:
    """The frame without the means to retake it."""
    if not isinstance(frame, RetakableFrame):
        return frame
    return Frame(**{name: getattr(frame, name) for name in Frame.__dataclass_fields__})


def retaken(frame: Frame, later_ns: int) -> Frame:
    """The frame with the picture of a later moment. Only for frames that can be retaken."""
    assert isinstance(frame, RetakableFrame), "only rendered frames can be retaken"
    assert frame.retake is not None
    assert frame.truth is not None
    first = frame.retake
    image, shown_ns = first(later_ns)
    truth = replace(frame.truth, shown_ns=shown_ns)
    return replace(frame, image=image, truth=truth, retake=lambda more_ns: first(later_ns + more_ns))


def with_picture_of(frame: Frame, other: Frame) -> Frame:
    """The frame showing what `other` shows, at its moment; both frames' faults act on it."""
    changed = replace(frame, image=other.image, truth=_truth(frame.truth, other.truth))
    if isinstance(changed, RetakableFrame) and isinstance(other, RetakableFrame):
        return replace(changed, retake=other.retake)
    return changed


def stood_still(frame: Frame) -> Frame:
    """The frame, showing the same whenever it is retaken."""
    if not isinstance(frame, RetakableFrame) or frame.truth is None:
        return frame
    still = (frame.image, frame.truth.shown_ns)
    return replace(frame, retake=lambda _: still)


def repainted(frame: Frame, paint: Paint) -> Frame:
    """The frame with `paint` applied to its picture, of whichever moment that is."""
    changed = replace(frame, image=paint(frame.image))
    if not isinstance(changed, RetakableFrame) or changed.retake is None:
        return changed
    before = changed.retake

    def retake(later_ns: int) -> tuple[Picture, int]:
        image, shown_ns = before(later_ns)
        return paint(image), shown_ns

    return replace(changed, retake=retake)


def _truth(own: Truth | None, shown: Truth | None) -> Truth | None:
    if own is None or shown is None:
        return shown
    return replace(shown, faults=tuple(dict.fromkeys((*own.faults, *shown.faults))))
