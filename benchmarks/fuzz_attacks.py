"""Files made to harm their readers: bombs, circles, lies about sizes, and what is no file."""

import os
import struct
from collections.abc import Callable, Mapping
from itertools import pairwise
from pathlib import Path
from random import Random

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


def attacks(form: str) -> tuple[bytes, ...]:
    """Return files of a format that ask for any time or memory, or contradict themselves."""
    return _ATTACKS.get(form, ())


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


def put_something_else(path: Path, rng: Random) -> str:
    """Put what is no ordinary file where one is expected; return what it is."""
    name = rng.choice(list(_NO_FILES))
    path.unlink(missing_ok=True)
    _NO_FILES[name](path)
    return name


def _sparse(path: Path) -> None:
    path.touch()
    os.truncate(path, 20_000_000_000)


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
