"""The elements of a Mitsuba scene file, with the values of their `$name`s; files of that kind name code to run.

So none of Mitsuba's code reads them: elements, their attributes and names of plugins are of closed lists.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError, TreeBuilder, XMLParser

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.files.validation import shortened

LARGEST = 8 << 20  # bytes of a file; its tree takes thirty times as much
LONGEST = 1000  # characters of a value with $names, also with theirs in their place: sixteen numbers take 400

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_VERSION = re.compile(r"(\d{1,9})\.\d+\.\d+", re.ASCII)
_DOLLAR = re.compile(r"\\\$|\$([^\s,$\\]*)")
_PROPERTIES = {"float", "integer", "boolean", "string"}


@dataclass(frozen=True)
class Node:
    """An element, and where it stands, as errors call it."""

    file: Path
    field: str
    element: Element

    def refused(self, value: str, expected: str) -> InputError:
        """The error about this element, of which `value` is wrong."""
        return InputError(self.file, self.field, shortened(value), expected)

    def attributes(self, required: Collection[str], optional: Collection[str] = ()) -> Mapping[str, str]:
        """All that it has.

        Raises:
            InputError: one is missing, or it has another one.
        """
        found = self.element.attrib
        for name in required:
            if name not in found:
                raise self.refused("", f'an attribute "{name}"')
        for name in found:
            if name not in required and name not in optional:
                known = ", ".join([*required, *optional])
                raise self.refused(f"with an attribute {name}", f"no attributes but {known}")
        return found

    def kind(self, known: Collection[str]) -> str:
        """The name of its plugin, which is one of those.

        Raises:
            InputError: it is another, or there is none.
        """
        kind = self.element.get("type", "")
        if kind not in known:
            raise self.refused(kind or "without a type", f"one of {', '.join(sorted(known))}")
        self.attributes(("type",), ("id", "name"))
        return kind

    def parts(self, properties: Mapping[str, Collection[str]], others: Collection[str] = ()) -> dict[str, Node]:
        """What stands inside, by its name, or its tag where it is none of `properties`.

        Args:
            properties: of each name the tags that it may have.
            others: tags of further elements.

        Raises:
            InputError: anything else stands there, or one thing twice.
        """
        found: dict[str, Node] = {}
        for element in self.element:
            tag, name = element.tag, element.get("name", "")
            key = name if tag in _PROPERTIES or tag == "transform" else tag
            if not (key in others if key == tag else tag in properties.get(key, ())):
                what = f"<{tag}>" if key == tag else f'<{tag} name="{name}">'
                raise self.refused(f"with {shortened(what)}", f"no elements but {', '.join([*properties, *others])}")
            if key in found:
                raise self.refused(f"with {key} twice", f"one {key}")
            found[key] = Node(self.file, f"{self.field}.{key}", element)
        return found

    def children(self) -> Iterator[Node]:
        """The elements inside, each called by its tag."""
        for element in self.element:
            yield Node(self.file, f"{self.field}.{shortened(element.tag)}", element)

    def text(self) -> str:
        """The value of a property."""
        value = self.attributes(("name", "value"))["value"]
        if len(self.element):
            raise self.refused("with elements inside", "a value alone")
        return value

    def number(self) -> float:
        """The value of a property, a finite number."""
        return self.number_in(self.text())

    def whole_number(self) -> int:
        """The value of a property, a whole number at least 0 and below 2³¹."""
        text = self.text().strip()
        if not re.fullmatch(r"\d{1,10}", text, re.ASCII) or int(text) >= 1 << 31:
            raise self.refused(text, "a whole number below 2³¹")
        return int(text)

    def number_in(self, text: str) -> float:
        """A text as a finite number."""
        text = text.strip()
        if not _NUMBER.fullmatch(text) or not math.isfinite(float(text)):
            raise self.refused(text, "a finite number")
        return float(text)

    def numbers_in(self, text: str, counts: Collection[int]) -> list[float]:
        """Numbers, with blanks or commas between them, as many as one of `counts`."""
        words = re.split("[ ,]+", text.strip(" ,"))
        if len(words) not in counts:
            raise self.refused(text, f"{' or '.join(map(str, counts))} numbers")
        return [self.number_in(word) for word in words]


def sensors_of(path: Path) -> list[Node]:
    """The sensors of a scene file, the values of `default`s before them in their `$name`s' place.

    Nothing else of the scene is looked at, and no file that it includes.

    Raises:
        InputError: the file is no XML of Mitsuba's, is larger than 8 MiB, declares a document type, or a `$name` in a
            sensor has no value.
    """
    root, found, defaults = _root(path), [], {}
    included = False
    for element in root:
        included |= element.tag == "include"
        if element.tag == "sensor":
            node = Node(path, f"sensor[{len(found)}]", element)
            _substitute(node, defaults, included)
            found.append(node)
        else:
            _define(path, element, defaults)
    return found


class _WithoutDocumentType(TreeBuilder):
    """A document type may define texts that are a billion characters long, or other files."""

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        raise ValueError("a document type is declared")


def _root(path: Path) -> Element:
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST + 1)
        if len(data) > LARGEST:
            raise ValueError("it is larger than 8 MiB")
        parser = XMLParser(target=_WithoutDocumentType())
        parser.feed(data)
        root = parser.close()
    except (OSError, ParseError, ValueError, LookupError) as error:  # LookupError of an encoding
        raise InputError(path, expected=f"a readable XML file ({shortened(str(error), 200)})") from None
    if root.tag != "scene":
        raise InputError(path, "", f"of <{shortened(root.tag)}>", "a <scene> of Mitsuba's")
    version = _VERSION.fullmatch(root.get("version", "3.0.0"))
    if version is None:
        raise InputError(path, "version", shortened(root.get("version", "")), "three numbers, such as 3.0.0")
    if int(version[1]) < 2:
        _rename(root)
    return root


def _rename(root: Element) -> None:
    """Names of properties as they are since Mitsuba 2: toWorld was to_world."""
    for element in root.iter():
        if element.tag != "default" and "name" in element.attrib:
            name = re.sub("(?<=[a-z])[A-Z]+", lambda found: f"_{found[0].lower()}", element.attrib["name"])
            element.set("name", name)


def _define(path: Path, element: Element, defaults: dict[str, str]) -> None:
    """Take over the `default`s in an element, or that it is; of two of one name the first counts."""
    for each in element.iter("default"):
        node = Node(path, "default", each)
        if len(each):
            raise node.refused("with elements inside", "a name and a value alone")
        _substitute(node, defaults)
        values = node.attributes(("name", "value"))
        defaults.setdefault(values["name"], values["value"])


def _substitute(node: Node, defaults: Mapping[str, str], included: bool = False) -> None:
    r"""Values for `$name`s, in all attributes; `\$` is a dollar, and of two names that fit the longer one is meant.

    Args:
        included: whether another file might give a name a value before this one does.
    """

    def value(found: re.Match[str]) -> str:
        if found[0] == "\\$":
            return "$"
        word = found[1]
        length = next((end for end in range(len(word), 0, -1) if word[:end] in defaults), 0)
        if not length:
            raise node.refused(found.string, "a $name that a <default> before it gives a value")
        if included:
            raise node.refused(found.string, "no $name, which an <include> could set: it is not read")
        return defaults[word[:length]] + word[length:]

    for element in node.element.iter():
        for key, text in element.attrib.items():
            if "$" in text:
                element.set(key, _short(node, _DOLLAR.sub(value, _short(node, text))))


def _short(node: Node, text: str) -> str:
    if len(text) > LONGEST:  # defaults of defaults grow by powers
        raise node.refused(text, f"at most {LONGEST} characters")
    return text
