"""Documents that a schema of files allows, or all but allows: what tests of readers are given."""

import copy
import json

import pytest
import yaml
from any_values import NAMES, NUMBERS, VALUES
from hypothesis import strategies as st
from small_cycle import SMALL

# By what a schema calls a field: values that lead further in than any text or number would.
_KNOWN = {
    "urdf": ["example:two_link", "example:nothing", "none.urdf", "example:two_link/"],
    "tool_frame": ["hand", "link1", "base"],
    "problem": ["example:two_link/around_a_post", "example:two_link/paper_1_30mm"],
    "joints": [["joint1", "joint2"], ["joint2", "joint1"], ["joint1"], [0.0, -1.0]],
    "links": [["link1", "post"], ["link2", "part"], ["hand", "base"]],
    "ignore": [[["link1", "post"]], [["post", "post"]]],
    "touch_links": [["hand"], ["link2"]],
    "link": ["hand", "link1"],
    "name": ["post", "part", "over", "link1"],
    "attach": ["part", "over"],
    "detach": ["part"],
    "preset": ["panda", "none.yaml"],
    "include": [[], "example:two_link/around_a_post"],
    "suh_bishop": [{"max_knots": 9}, {"max_knots": "many"}, {"nothing": 1}],
}
PROBLEM = {
    "robot": {
        "urdf": "example:two_link",
        "tool_frame": "hand",
        "gravity": [0, 0, 0],
        "limits": {"velocity": {"joint1": 50.0, "joint2": 50.0}},
        "payload": {"mass": 0.5},
    },
    "tube": {
        "points": [[0.3, -0.3, 0], [0.3, 0.3, 0]],
        "radius": 0.03,
        "joint_signs": {"joint2": "-"},
    },
    "start": {"seed": [0.0, -1.0]},
    "goal": {"position": [0.3, 0.3, 0], "tolerance": 0.01},
    "obstacles": [{"name": "post", "cylinder": [0.03, 0.3], "position": [0.45, 0, 0]}],
    "clearance": {"default": 0.001, "pairs": [{"links": ["link2", "post"], "clearance": 0.002}]},
    "objective": {"slack": 0.01},
}
CYCLE = yaml.safe_load(SMALL)
_KEYS = st.sampled_from(["joint1", "joint2", "tube.radius", "clearance", "objective.slack"])
_SMALL = st.sampled_from([0.0, 0.01, 0.03, 0.3, -0.3, 1.0, 3.0])
_MAX_ITEMS = 3
_DEEP = 150  # more than a file may be nested


def whole_documents(schema):
    """Return a strategy for documents as a schema has them, of any numbers and texts."""
    return _of(schema, schema, "")


@st.composite
def changed_documents(draw, base, schema, most=4):
    """Return a document, valid but for some places that hold other values or are not there.

    Args:
        draw: Hypothesis's.
        base: A valid document.
        schema: Its JSON schema, by which places are found that the document does not have.
        most: How many places are changed.
    """
    document = copy.deepcopy(base)
    for _ in range(draw(st.integers(1, most))):
        _change(draw, document, schema, schema)
    return document


def _change(draw, holder, node, schema):
    """Change one place in a list or map, which a node of a schema describes."""
    while True:
        node = _alternative(node, schema, holder)
        key, below = draw(_steps(holder, node))
        held = _held(holder, key)
        if isinstance(held, dict | list) and held and draw(st.integers(0, 3)):
            holder, node = held, below
            continue
        _put(holder, key, draw(_values(key, below, schema)))
        return


def _steps(holder, node):
    """Return a strategy for keys of a list or map, and the nodes below them."""
    if isinstance(holder, list):
        prefix = node.get("prefixItems", [])
        nodes = [
            prefix[k] if k < len(prefix) else node.get("items", {}) for k in range(len(holder))
        ]
        return st.sampled_from(list(enumerate(nodes)))
    known = list(node.get("properties", {}).items())
    others = node.get("additionalProperties") or {}
    others = {} if others is True else others
    given = [(key, others) for key in holder if key not in dict(known)]
    steps = st.sampled_from(known + given) if known + given else st.nothing()
    return steps | st.tuples(NAMES | _KEYS, st.just(others))


def _held(holder, key):
    if isinstance(holder, list):
        return holder[key]
    return holder.get(key)


_GONE = object()


def _values(key, node, schema):
    """Return a strategy for what is put at a place: mostly what its schema allows."""
    right = _of(node, schema, key)
    return st.one_of(right, right, right, VALUES, st.just(_GONE), st.just(_deep()))


def _put(holder, key, value):
    if value is not _GONE:
        holder[key] = value
    elif isinstance(holder, list) or key in holder:
        del holder[key]


def _deep():
    value = 0
    for _ in range(_DEEP):
        value = [value]
    return value


def _alternative(node, schema, held):
    """Return the alternative of a node that is of the kind of what is held there."""
    node = _resolved(node, schema)
    kind = "array" if isinstance(held, list) else "object"
    choices = [_resolved(each, schema) for each in node.get("anyOf", node.get("oneOf", [node]))]
    fitting = [each for each in choices if each.get("type") == kind]
    if kind == "object" and held is not None:
        fitting.sort(key=lambda each: -len(each.get("properties", {}).keys() & held.keys()))
    return fitting[0] if fitting else {}


def _resolved(node, schema):
    name = node.get("$ref", "").removeprefix("#/$defs/")
    return schema["$defs"][name] if name else node


def _of(node, schema, key):
    """Return a strategy for values of a node of a schema, which a key leads to."""
    node = _resolved(node, schema)
    made = _by_kind(node, schema, key)
    known = _KNOWN.get(key)
    return made if known is None else st.one_of(st.sampled_from(known), made)


def _by_kind(node, schema, key):
    for word in ("anyOf", "oneOf"):
        if word in node:
            return st.one_of(*(_of(each, schema, "") for each in node[word]))
    if "enum" in node or "const" in node:
        return st.sampled_from(node.get("enum", [node.get("const")]))
    kind = node.get("type")
    if kind == "object":
        return _objects(node, schema)
    if kind == "array":
        return _arrays(node, schema)
    scalars = {
        "number": _SMALL | NUMBERS,
        "integer": st.integers(-1, 5) | st.sampled_from([10**6, 10**30]),
        "string": NAMES,
        "boolean": st.booleans(),
        "null": st.none(),
    }
    return scalars.get(kind, VALUES)


def _arrays(node, schema):
    if "prefixItems" in node:
        return st.tuples(*(_of(each, schema, "") for each in node["prefixItems"])).map(list)
    return st.lists(st.deferred(lambda: _of(node.get("items", {}), schema, "")), max_size=3)


def _objects(node, schema):
    """Return a strategy for maps: what is required, and few of the other keys."""
    parts = {
        key: st.deferred(lambda key=key, each=each: _of(each, schema, key))
        for key, each in node.get("properties", {}).items()
    }
    required = {key: parts[key] for key in node.get("required", [])}
    others = st.just({})
    if optional := [key for key in parts if key not in required]:
        keys = st.lists(st.sampled_from(optional), max_size=_MAX_ITEMS, unique=True)
        others = keys.flatmap(lambda keys: st.fixed_dictionaries({key: parts[key] for key in keys}))
    if isinstance(below := node.get("additionalProperties"), dict):
        below = _of(below, schema, "")
        others = st.dictionaries(_KEYS | NAMES, below, max_size=_MAX_ITEMS)
    return st.builds(
        lambda first, second: {**second, **first}, st.fixed_dictionaries(required), others
    )


def written(file, document):
    """Write a document as JSON; return whether JSON can hold it."""
    try:
        file.write_text(json.dumps(document))
    except (TypeError, ValueError):
        return False
    return True


def require_told(status, out, err, as_json):
    """Fail unless a run says what came of it: in one JSON object, or what is wrong in one line."""
    assert status in (0, 1, 2)
    assert all(character.isprintable() for character in (out + err).replace("\n", ""))
    assert "internal error" not in out + err
    if as_json:
        assert err == ""
        json.loads(out, parse_constant=lambda word: pytest.fail(f"{word} is no JSON"))
    elif status == 2:
        assert (out, len(err.splitlines())) == ("", 1)
