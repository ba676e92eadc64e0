"""What a window does, without the window: it takes events, draws, reads anew, and saves pictures."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import moderngl

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.errors.printable import printable
from fit_material.renderer.files.atomic import write_bytes_atomically
from fit_material.renderer.images.image_file import png, write_exr
from fit_material.renderer.opengl.drawing import Stage
from fit_material.renderer.viewer.bookmarks import Bookmarks, bookmarks_file
from fit_material.renderer.viewer.compare import Photograph, Photographs
from fit_material.renderer.viewer.controls import Command, Controls
from fit_material.renderer.viewer.display import Codes, Display, draw_whole
from fit_material.renderer.viewer.eye import Eye
from fit_material.renderer.viewer.help import help_text
from fit_material.renderer.viewer.look import Look
from fit_material.renderer.viewer.pace import Pace
from fit_material.renderer.viewer.turntable import FRAMES, free_name, turntable
from fit_material.renderer.viewer.watch import Watch
from fit_material.renderer.viewer_model.model import Model
from fit_material.renderer.viewer_model.viewer_light import Surroundings


@dataclass(frozen=True)
class Subject:
    """What a session is about.

    Attributes:
        read: reads the model; called again when one of its files changes.
        surroundings: the light.
        look: to begin with.
        photographs: to compare with.
        antialias: samples along each side of a pixel, once nothing moves.
        neighbours: let every reflective object of several mirror the others.
        out: folder for pictures and turntables.
    """

    read: Callable[[], Model]
    surroundings: Surroundings
    look: Look
    photographs: Photographs | None = None
    antialias: int = 4
    neighbours: bool = True
    out: Path = Path()


class Session:
    """One model on show.

    Args:
        context: OpenGL 4.3 or newer, through `context.prepared`.
        subject: of the pictures.
        model: as `subject.read` has read it.

    Attributes:
        controls: what keys and mouse change.
        title: one line.
        size: of the framebuffer in pixels; whoever has a window keeps it up to date.
        wants_to_quit: the user has had enough.
    """

    def __init__(self, context: moderngl.Context, subject: Subject, model: Model) -> None:
        self._context, self._subject = context, subject
        self._display = Display(context, subject.antialias)
        self._stage = self._staged(model)
        self._watch = Watch(model.files)
        self._film: Iterator[int] | None = None
        self._changed = True
        self._pace = Pace()
        bookmarks = Bookmarks(bookmarks_file(model.files[0]))
        cameras = subject.photographs.cameras if subject.photographs else ()
        self.controls = Controls(subject.look, self._stage.bounds, bookmarks, cameras)
        self.name = model.files[0].stem
        self.title = self.controls.message or "H shows the keys"
        self.size: tuple[int, int] = (1, 1)
        self.wants_to_quit = False
        with self._told():
            bookmarks.load()
        for remark in model.remarks:
            self._tell(remark, aloud=True)

    @property
    def busy(self) -> bool:
        """Whether there is something to draw or to do without waiting for the user."""
        moving = self._pace.moving(time.perf_counter())
        return self._changed or moving or not self._display.finished or self._film is not None

    def press(self, key: str, shift: bool = False) -> None:
        """A key went down; see `Controls.press`."""
        with self._told():
            command = self.controls.press(key, shift, self._aspect)
            self._tell(self.controls.message)
            if command is not None:
                self._obey(command)
        self._changed = True

    def drag(self, button: str, right: float, down: float, shift: bool = False) -> None:
        """The mouse moved; see `Controls.drag`."""
        self.controls.message = ""
        edge = self.controls.look.edge
        self.controls.drag(button, right, down, shift, self._aspect)
        self._tell(self.controls.message)
        if self.controls.look.edge == edge:  # a swipe moves nothing in the render, which stays as fine as it is
            self._moved()
        self._changed = True

    def scroll(self, notches: float) -> None:
        """The wheel turned; see `Controls.scroll`."""
        self.controls.scroll(notches)
        self._moved()

    def walk(self, held: set[str], seconds: float) -> None:
        """Time passed with keys held; see `Controls.pass_time`."""
        if self.controls.walks(held):
            self.controls.pass_time(held, seconds)
            self._moved()

    def refresh(self) -> None:
        """The window wants to be drawn anew."""
        self._changed = True

    def look_for_changes(self) -> None:
        """Read the model anew if one of its files was changed; to be called now and then."""
        if self._watch.changed():
            self._reload()

    def film(self) -> None:
        """Draw the next frame of a turntable, if one is being made."""
        if self._film is None:
            return
        done = None
        with self._told():
            done = next(self._film, None)
        if done is None:  # at its end, or it raised
            self._film = None
        self._changed = True

    def draw(self, framebuffer: moderngl.Framebuffer) -> None:
        """Draw one more sample of the picture, and show it."""
        begun = time.perf_counter()
        coarseness = self._pace.coarseness(begun)
        self._changed = coarseness > 1  # not the final picture
        with self._told():
            photograph = self._photograph()
            self._display.draw(framebuffer, self.size, self._stage, self.controls.look, photograph, coarseness)
        if coarseness == 1:
            self._context.finish()
            self._pace.measure(time.perf_counter() - begun)

    def release(self) -> None:
        """Give the memory back."""
        self._stop_film()
        self._stage.release()
        self._display.release()

    def _moved(self) -> None:
        self._pace.move(time.perf_counter())
        self._changed = True

    @property
    def _aspect(self) -> float:
        width, height = self.size
        return max(1, width) / max(1, height)

    def _staged(self, model: Model) -> Stage:
        return Stage(self._context, model, self._subject.surroundings, neighbours=self._subject.neighbours)

    def _photograph(self) -> Photograph | None:
        """The photograph to compare with; one that cannot be read ends the comparison."""
        look = self.controls.look
        if self._subject.photographs is None or look.comparison == "off":
            return None
        try:
            return self._subject.photographs[look.photograph]
        except InputError:
            self.controls.look = replace(look, comparison="off")
            self._changed = True
            raise

    def _reload(self) -> None:
        """The model as it is on disk now; the shown one stays where that cannot be read."""
        with self._told():
            model = self._subject.read()
            stage = self._staged(model)
            self._stage.release()
            self._stage, self.controls.bounds = stage, stage.bounds
            self._watch.follow(model.files)
            self._display.forget()
            self._changed = True
            self._tell("read again")
            for remark in model.remarks:
                self._tell(remark, aloud=True)

    def _obey(self, command: Command) -> None:
        if command is Command.QUIT:
            self._quit()
        elif command is Command.PICTURE:
            self._save_picture()
        elif command is Command.TURNTABLE and self._film is None:
            self._film = self._filmed(free_name(self._subject.out, f"{self.name}-turntable", ""))
        elif command is Command.RELOAD:
            self._reload()
        elif command is Command.HELP:
            print(help_text(), flush=True)
            self._tell("the keys are listed in the terminal")

    def _quit(self) -> None:
        """First a turntable that is being made, then the session."""
        self.wants_to_quit = self._film is None
        if self._film is not None:
            self._stop_film()
            self._tell("turntable given up, nothing written")

    def _save_picture(self) -> None:
        codes = self._whole(self.controls.look)
        path = free_name(self._subject.out, self.name, ".png", ".exr")
        write_exr(f"{path}.exr", self._display.linear())
        write_bytes_atomically(f"{path}.png", png(codes))
        self._tell(f"saved {path}.png and {path.name}.exr", aloud=True)

    def _filmed(self, folder: Path) -> Iterator[int]:
        look = replace(self.controls.look, comparison="off")

        def draw(eye: Eye) -> Codes:
            return self._whole(replace(look, eye=eye))

        for done in turntable(folder, look.eye, FRAMES, draw):
            self._tell(f"turntable: {done} of {FRAMES} frames; Esc gives it up")
            yield done
        self._tell(f"saved {folder}", aloud=True)

    def _stop_film(self) -> None:
        if self._film is not None:
            self._film.close()  # type: ignore[attr-defined] — a generator
        self._film = None

    def _whole(self, look: Look) -> Codes:
        photograph = None if look.comparison == "off" else self._photograph()
        return draw_whole(self._context, self._display, self.size, self._stage, look, photograph)

    @contextmanager
    def _told(self) -> Iterator[None]:
        """What goes wrong is one sentence, and the session goes on."""
        try:
            yield
        except InputError as error:
            self._tell(str(error), aloud=True)

    def _tell(self, message: str, aloud: bool = False) -> None:
        """A message in the title; aloud: in the terminal too."""
        self.title = message or self.title
        if aloud:
            print(printable(message), file=sys.stderr, flush=True)
