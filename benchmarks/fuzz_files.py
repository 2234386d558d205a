"""Damaged files: contents with mutations, files made to harm their readers, and what is no file."""

import json
import os
import struct
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Mapping
from itertools import pairwise
from pathlib import Path
from random import Random
from typing import Any

import yaml

HOSTILE_NAMES = (
    "<script>alert(1)</script>",
    "</script><img src=x onerror=alert(1)>",
    "<!--",
    "\"'`&amp;<b>",
    "\x1b[31mred\x1b[0m",
    "back\rwards",
    "turned\u202eover",
    "two\nlines",
    "nul\x00l",
    "=1+1",
    "@SUM(A1)",
    "{{data}}",
    "[bold]markup[/bold]",
    "%s {0} \\",
    "x" * 5000,
    "\ud7ff\ufffe\u2028",
    "",
)
PATHS = (
    *("/dev/zero", "/dev/null", "/dev/stdin", "/", "..", "../..", ".", "~", "/etc/passwd", "/proc"),
    *("file:///dev/zero", "package://../x", "package://", "package:///dev/zero", "example:"),
    *("example:../x", "example:ur5/over_the_wall", "a/" * 3000, "n" * 300, "problem.yaml"),
    *("robot.urdf", "motion.json", "pipe", "zero", "folder", "nul\x00l", "http://localhost:1/x"),
)
NUMBERS = (
    *(0, -1, 1, 2, 0.5, 1e-9, 1e-320, 1e9, 1e18, 1e19, 1e154, -1e308, 1e308, 10**30, 10**400),
    *(2**31, 2**32, 2**63, -(2**63) - 1, float("nan"), float("inf"), float("-inf"), True, False),
)
_WORDS = (
    *map(str, NUMBERS[:-2]),
    *("NaN", ".nan", "1e400", "9" * 5000, "0x10", "1_0", "true", "null", "[]", "{}", "''"),
    *("&a", "*a", "<<: *a", "!!python/object:os.system", "- ", ": ", ",", "<", ">", '"', "'", "#"),
    *("\t", "\x00", "\ufeff", "\r", "{", "[", "}", "]", "|", "---\n", "%"),
    *(" " * 200, "\n" * 50, "-", "+", "e", ".", ";"),
)
_Mutation = Callable[[bytes, Random], bytes]
_ROBOT = '<robot name="arm"><link name="base"/>{}</robot>'
_ENTITIES = "".join(f'<!ENTITY {chr(98 + k)} "{f"&{chr(97 + k)};" * 10}">' for k in range(10))
_BOMB = f'<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a "{"a" * 100}">{_ENTITIES}]>'
_CHAIN = "".join(
    f'<link name="l{k}"/><joint name="j{k}" type="fixed">'
    f'<parent link="{f"l{k - 1}" if k else "base"}"/><child link="l{k}"/></joint>'
    for k in range(20_000)
)
_CALLS = "".join(
    f'<xacro:macro name="m{k}"><xacro:m{k - 1}/><xacro:m{k - 1}/></xacro:macro>'
    for k in range(1, 40)
)


def mutated(content: bytes, form: str, rng: Random) -> bytes:
    """Return contents with one to four mutations.

    Args:
        content: Of a file that is right.
        form: Its format: yaml, json, xml, csv, stl or text.
        rng: What is drawn from.
    """
    choices = (*_OF_FORMAT.get(form, ()), *(_BINARY if form == "stl" else _TEXT))
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        content = rng.choice(choices)(content, rng)
    return content


def any_value(rng: Random) -> Any:
    """Return a value that may stand anywhere in a document."""
    kind = rng.randrange(8)
    if kind < 3:
        return rng.choice(NUMBERS)
    if kind < 6:
        return rng.choice((rng.choice(HOSTILE_NAMES), rng.choice(PATHS), "+", "any", "wall"))
    if kind == 6:
        return [any_value(rng) for _ in range(rng.choice((0, 1, 2, 3, 7)))]
    return {str(any_value(rng))[:40]: any_value(rng) for _ in range(rng.randrange(3))}


def attacks(form: str) -> tuple[bytes, ...]:
    """Return files of a format that ask for any time or memory, or contradict themselves."""
    return _ATTACKS.get(form, ())


def put_something_else(path: Path, rng: Random) -> str:
    """Put what is no ordinary file where one is expected; return what it is."""
    name = rng.choice(list(_NO_FILES))
    path.unlink(missing_ok=True)
    _NO_FILES[name](path)
    return name


def _changed_tree(root: Any, rng: Random) -> Any:
    """Change one value of a document, somewhere."""
    places = _positions(root)
    if not places:
        return any_value(rng)
    holder, key = rng.choice(places)
    action = rng.randrange(9)
    if action < 4:
        holder[key] = any_value(rng)
    elif action == 4:
        del holder[key]
    elif action == 5 and isinstance(holder, dict):
        holder[rng.choice((*HOSTILE_NAMES, *(str(k) for _, k in places)))] = holder.pop(key)
    elif action == 6:
        other, there = rng.choice(places)
        holder[key], other[there] = other[there], holder[key]
    elif action == 7 and isinstance(holder[key], list):
        holder[key] = holder[key] * rng.choice((2, 3, 50))
    else:
        holder[key] = [holder[key]]
    return root


def _positions(node: Any) -> list[tuple[Any, Any]]:
    """Return all that holds a value, and the key or index it is held by."""
    keys = list(node) if isinstance(node, dict) else range(len(node)) if _is_list(node) else ()
    return [place for key in keys for place in [(node, key), *_positions(node[key])]]


def _is_list(node: Any) -> bool:
    return isinstance(node, list)


def _yaml_tree(content: bytes, rng: Random) -> bytes:
    try:
        tree = yaml.load(content, yaml.CSafeLoader)
        return yaml.dump(
            _changed_tree(tree, rng), Dumper=_NoAliases, allow_unicode=True, sort_keys=False
        ).encode("utf-8", "replace")
    except (yaml.YAMLError, ValueError, RecursionError, TypeError):
        return content


class _NoAliases(yaml.SafeDumper):
    def ignore_aliases(self, data: Any) -> bool:
        """Write everything out; what holds itself ends by a RecursionError."""
        return True


def _json_tree(content: bytes, rng: Random) -> bytes:
    try:
        return json.dumps(_changed_tree(json.loads(content), rng)).encode()
    except (ValueError, RecursionError):
        return content


def _xml_tree(content: bytes, rng: Random) -> bytes:
    try:
        root = ElementTree.fromstring(content)
        _change_element(root, rng)
        return ElementTree.tostring(root, encoding="utf-8")
    except (ElementTree.ParseError, ValueError, LookupError, TypeError):
        return content


def _change_element(root: ElementTree.Element, rng: Random) -> None:
    element = rng.choice(list(root.iter()))
    action = rng.randrange(8)
    if action < 4 and element.attrib:
        name = rng.choice(list(element.attrib))
        words = (element.attrib[name] or "0").split()
        words[rng.randrange(len(words) or 1) :][:1] = []
        value = rng.choice((*_WORDS, *HOSTILE_NAMES, *PATHS))
        kept = rng.random() < 0.5
        element.set(name, " ".join([value, *words]) if kept else value)
    elif action == 4 and len(element):
        element.remove(rng.choice(list(element)))
    elif action == 5 and len(element):
        element.extend([rng.choice(list(element))] * rng.choice((1, 2, 30)))
    elif action == 6:
        element.tag = rng.choice([each.tag for each in root.iter()])
    elif element.attrib:
        del element.attrib[rng.choice(list(element.attrib))]
    else:
        element.text = rng.choice((*_WORDS, *PATHS))


def _csv_table(content: bytes, rng: Random) -> bytes:
    rows = [row.split(b",") for row in content.splitlines()]
    row = rng.choice(rows) if rows else []
    action = rng.randrange(6)
    if action == 0 and row:
        row[rng.randrange(len(row))] = rng.choice((*_WORDS, *HOSTILE_NAMES)).encode()
    elif action == 1:
        for each in rows:
            each.append(each[0])
    elif action == 2:
        for each in rows:
            del each[-1:]
    elif action == 3:
        rows[:0] = [row] * rng.choice((1, 3))
    elif action == 4:
        return content.replace(b",", rng.choice((b";", b"\t", b" ", b",,", b'","')))
    else:
        rows = rows[:1] + rows[1:][::-1]
    return b"\n".join(map(b",".join, rows))


def _words(content: bytes, rng: Random) -> bytes:
    """Delete, double, swap or replace a word, or put one in."""
    text = content.decode("utf-8", "surrogateescape")
    words, begin = [], 0
    for k in range(1, len(text) + 1):
        if k == len(text) or text[k].isalnum() != text[begin].isalnum():
            words.append(text[begin:k])
            begin = k
    at, other = rng.randrange(len(words) or 1), rng.randrange(len(words) or 1)
    new = rng.choice((*_WORDS, *PATHS, *HOSTILE_NAMES))
    action = rng.randrange(6)
    if action == 0:
        words[at : at + rng.choice((1, 1, 5))] = []
    elif action == 1:
        words[at:at] = words[at : at + 1] * rng.choice((1, 10, 3000))
    elif action == 2 and words:
        words[at], words[other] = words[other], words[at]
    elif action == 3:
        words[at:at] = [new]
    else:
        words[at : at + 1] = [new]
    return "".join(words).encode("utf-8", "surrogateescape")


def _flipped(content: bytes, rng: Random) -> bytes:
    data = bytearray(content)
    for _ in range(rng.choice((1, 3, 20))):
        if data:
            data[rng.randrange(len(data))] = rng.randrange(256)
    return bytes(data)


def _cut(content: bytes, rng: Random) -> bytes:
    return content[: rng.randrange(len(content) + 1)]


def _repeated(content: bytes, rng: Random) -> bytes:
    begin = rng.randrange(len(content) + 1)
    part = content[begin : begin + rng.choice((1, 20, 200))]
    return content[:begin] + part * rng.choice((2, 100)) + content[begin:]


def _encoded(content: bytes, rng: Random) -> bytes:
    text = content.decode("utf-8", "replace")
    return text.encode(rng.choice(("utf-16", "utf-32", "utf-8-sig", "latin-1")), "replace")


def _other_lines(content: bytes, rng: Random) -> bytes:
    return content.replace(b"\n", rng.choice((b"\r\n", b"\r", b"\n\n", b"", "\u2028".encode())))


def _stl_count(content: bytes, rng: Random) -> bytes:
    count = rng.choice((0, 1, 13, 10**7, 2**31, 2**32 - 1))
    return content[:80] + struct.pack("<I", count) + content[84:]


def _stl_number(content: bytes, rng: Random) -> bytes:
    numbers = (float("nan"), float("inf"), 3e38, -3e38, 1e-40, 0.0, 1e5)
    at = 84 + 4 * rng.randrange(max(1, (len(content) - 84) // 4))
    return content[:at] + struct.pack("<f", rng.choice(numbers)) + content[at + 4 :]


def _yaml() -> tuple[bytes, ...]:
    laughs = ["a: &a [x, x, x, x, x, x, x, x, x]"]
    laughs += [f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]" for a, b in pairwise("abcdefghi")]
    return (
        "\n".join(laughs).encode(),
        b"a: &a [*a]\n",
        b"<<: &a {<<: *a}\n",
        b"[" * 100_000,
        b"{a: " * 50_000,
        b"- " * 50_000,
        b"? " * 50_000,
        b"robot: " + b"9" * 1_000_000,
        b"!!python/object/apply:os.system [touch stray]\n",
        b"include: [problem.yaml, cell.yaml]\nrobot: {}\n",
        b"include: /dev/zero\n",
        b"include: pipe\n",
        b"include: folder\n",
        b"".join(b"k%d: {}\n" % k for k in range(100_000)),
        b"k: [" + b"1, " * 500_000 + b"1]\n",
        b"&" * 100_000,
        b"---\n" * 10_000,
        b"%YAML 9.9\n---\nrobot: {}\n",
        b"'" + b"a" * 5_000_000 + b"'",
    )


def _json() -> tuple[bytes, ...]:
    return (
        b"[" * 1_000_000,
        b'{"a":' * 100_000,
        b'{"robot": 1e999, "tube": -Infinity, "start": NaN}',
        b"9" * 1_000_000,
        b'"' + b"\\ud800" * 1000 + b'"',
        b'{"breakpoints": ' + b"[" * 60 + b"]" * 60 + b"}",
        b"{" + b",".join(b'"k%d": 0' % k for k in range(100_000)) + b"}",
    )


def _xml() -> tuple[bytes, ...]:
    return (
        (_BOMB + "<robot name='&k;'/>").encode(),
        (_BOMB + "<robot>&k;</robot>").encode(),
        b'<!DOCTYPE r [<!ENTITY x SYSTEM "file:///dev/zero">]><robot name="a">&x;</robot>',
        b'<!DOCTYPE robot SYSTEM "file:///dev/zero"><robot name="a"/>',
        b"<robot>" + b"<link>" * 100_000,
        b'<robot name="a">' + b"<a>" * 50_000 + b"</a>" * 50_000 + b"</robot>",
        b'<?xml version="1.0" encoding="rot13"?><robot/>',
        b'<?xml version="1.0" encoding="utf-7"?><robot/>',
        _ROBOT.format(_CHAIN).encode(),
        _ROBOT.format('<link name="base"/>' * 50_000).encode(),
        _ROBOT.format("".join(f'<link name="l{k}"/>' for k in range(50_000))).encode(),
    )


def _xacro() -> tuple[bytes, ...]:
    head = '<robot name="a" xmlns:xacro="http://www.ros.org/wiki/xacro">'
    bodies = (
        '<xacro:include filename="/dev/zero"/>',
        '<xacro:include filename="pipe"/>',
        '<xacro:include filename="folder"/>',
        '<xacro:include filename="arm.urdf.xacro"/>',
        '<xacro:include filename="*"/>',
        f'<xacro:macro name="m0"><link name="x"/></xacro:macro>{_CALLS}<xacro:m39/>',
        '<xacro:macro name="m"><xacro:m/></xacro:macro><xacro:m/>',
        '<link name="${10**10**10}"/>',
        '<link name="${len([x for x in range(10**10)])}"/>',
        "<link name=\"${'a' * 10**11}\"/>",
        "<link name=\"${'a' * 10**8}\"/>",
        "<link name=\"${__import__('os').system('touch stray')}\"/>",
        '<xacro:property name="p" value="${p}"/><link name="${p}"/>',
        '<xacro:property name="p" value="${load_yaml(\'/dev/zero\')}"/><link name="${p}"/>',
        '<xacro:if value="maybe"/>',
        '<link name="$(find nowhere)"/>',
        '<link name="$(env HOME)"/><link name="$(optenv X)"/><link name="$(eval 1/0)"/>',
        '<link name="$(arg nothing)"/>',
        "${",
        "<xacro:insert_block name='b'/>",
    )
    return tuple(f"{head}{body}</robot>".encode() for body in bodies)


def _csv() -> tuple[bytes, ...]:
    return (
        b'"' + b"a" * 1_000_000,
        b"time,joint1.position\n" + b"0,1\n" * 200_000,
        b",".join(b"c%d" % k for k in range(50_000)) + b"\n" + b"0," * 49_999 + b"0\n",
        b"x,y,z\n" + b"0,0,0\n" * 50_000,
        b"\n" * 1_000_000,
        b"0,0,0\n1,1\n",
        b"time,joint1.position,joint2.position\n0,0,0\n1e300,1e9,1\n",
        b"time;joint1.position\n0;0\n",
        b"\xef\xbb\xbftime,joint1.position,joint2.position\r\n0,0,0\r\n1,1,1\r\n",
    )


def _stl() -> tuple[bytes, ...]:
    triangle = struct.pack("<12fH", 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0)
    return (
        b" " * 80 + struct.pack("<I", 10_000_000) + triangle,
        b" " * 80 + struct.pack("<I", 1) + triangle,
        b" " * 80 + struct.pack("<I", 20_000) + triangle * 20_000,
        b"solid x\n" + b"facet normal 0 0 1\nouter loop\n" * 10_000,
        b"solid x\nfacet normal a b c\n outer loop\n vertex 1 2\n endloop\nendfacet\nendsolid x\n",
        b"solid " + b"x" * 1_000_000,
        b"",
    )


def _obj() -> tuple[bytes, ...]:
    corners = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
    return (
        corners + b"f 1 2 -9\n",
        corners + b"f 1 2 99999999999999999999\n",
        corners + b"f 0 0 0\n",
        corners + b"f 1/2/3 2//9 3/1\n",
        corners + b"f 1 2\nf 1\nf\n",
        corners + b"f " + b"1 2 3 4 " * 100_000 + b"\n",
        b"mtllib /dev/zero\n" + corners + b"usemtl a\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n",
        b"mtllib pipe\n" + corners + b"usemtl a\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n",
        b"mtllib ../../x.mtl\n" + corners + b"f 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n",
        corners * 20_000 + b"f 1 2 3\n",
        b"v nan nan nan\n" * 4 + b"f 1 2 3\n",
        b"v 1e400 0 0\n" + corners + b"f 1 2 3\n",
    )


def _dae() -> tuple[bytes, ...]:
    name = b'<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">'
    bomb = _BOMB.replace("DOCTYPE x", "DOCTYPE COLLADA").encode()
    return (
        bomb + name + b"<asset>&k;</asset></COLLADA>",
        b'<!DOCTYPE COLLADA [<!ENTITY x SYSTEM "/dev/zero">]>' + name + b"&x;</COLLADA>",
        name + b"</COLLADA>",
        name + b"<asset><unit meter='nan'/></asset></COLLADA>",
        name + b"<node>" * 50_000,
        name
        + b"<library_nodes><node id='n'><instance_node url='#n'/></node></library_nodes></COLLADA>",
    )


def _sparse(path: Path) -> None:
    path.touch()
    os.truncate(path, 20_000_000_000)


_BINARY: tuple[_Mutation, ...] = (_flipped, _cut, _repeated)
_TEXT: tuple[_Mutation, ...] = (_words, _words, _words, *_BINARY, _encoded, _other_lines)
_OF_FORMAT: dict[str, tuple[_Mutation, ...]] = {
    "yaml": (_yaml_tree,) * 8,
    "json": (_json_tree,) * 8,
    "xml": (_xml_tree,) * 8,
    "csv": (_csv_table,) * 6,
    "stl": (_stl_count, _stl_number, _stl_number),
}
_ATTACKS: Mapping[str, tuple[bytes, ...]] = {
    "yaml": _yaml(),
    "json": _json(),
    "xml": _xml(),
    "xacro": _xacro(),
    "csv": _csv(),
    "stl": _stl(),
    "obj": _obj(),
    "dae": _dae(),
}
_NO_FILES: Mapping[str, Callable[[Path], None]] = {
    "a folder": Path.mkdir,
    "a pipe": os.mkfifo,
    "endless zeros": lambda path: path.symlink_to("/dev/zero"),
    "a link to nothing": lambda path: path.symlink_to("nowhere/nothing"),
    "a link to itself": lambda path: path.symlink_to(path.name),
    "nothing": lambda path: None,
    "an empty file": Path.touch,
    "20 GB of zeros": _sparse,
}
