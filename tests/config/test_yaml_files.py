"""YAML files into models: every finding with its place, in words."""

import re
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Field, model_validator

from crowdsim.config.files import Faults, Finding, StrictModel, dump_yaml, find_faults, load_model, place
from crowdsim.config.tree import read_document
from crowdsim.errors import RecipeError


class Disc(StrictModel):
    kind: Literal["disc"]
    radius: float = Field(gt=0)
    share: float = Field(default=0.5, ge=0, le=1)


class Grid(StrictModel):
    kind: Literal["grid"]
    columns: int = Field(default=2, ge=1)
    flat: bool = False


class Seconds(StrictModel):
    seconds: float = Field(gt=0)


class Show(StrictModel):
    renamed: ClassVar[dict[str, str]] = {"title": "name", "loop": "mode"}

    name: str
    seed: int = Field(default=0, ge=0)
    duration: Annotated[int, Field(ge=1)] | Seconds = 3
    size: tuple[float, float] = (1.0, 2.0)
    places: tuple[Annotated[Disc | Grid, Field(discriminator="kind")], ...] = ()
    either: Disc | Grid | None = None
    named: dict[str, Grid] = Field(default_factory=dict)
    mode: Literal["fast", "slow"] | None = Field(default=None, description="How; null: as it comes.")
    note: str | None = None

    @model_validator(mode="after")
    def _check(self) -> Any:
        if self.seed == 13:
            raise Faults([Finding(("seed",), "is 13, expected luck"), Finding(("named", "x"), "has no friend")])
        return self

    @classmethod
    def findings_in(cls, data: Any) -> list[Finding]:
        return [Finding(("note",), "is 'nobody', expected somebody")] if data.get("note") == "nobody" else []


@pytest.fixture
def write(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def write(text: str | bytes) -> str:
        Path("show.yaml").write_bytes(text if isinstance(text, bytes) else text.encode())
        return "show.yaml"

    return write


def findings(path: str, *overrides: str) -> list[str]:
    return [str(finding) for finding in find_faults(path, Show, overrides)]


KEYS = "name, seed, duration, size, places, either, named, mode"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "1:1: the file is empty, expected a mapping with name"),
        ("# nothing\n", "1:1: the file is empty, expected a mapping with name"),
        ("- 1\n", "1:1: the file holds a list, expected a mapping with name"),
        ("hello", "1:1: the file holds 'hello', expected a mapping with name"),
        ("name: a\nsede: 3", f"2:1: sede: unknown key, expected {KEYS} or note (did you mean 'seed'?)"),
        ("name: a\nseed: 1\nseed: 2", "3:1: seed: duplicate key, expected it once; it is already in line 2"),
        ("seed: 1", "1:1: name: missing, expected text"),
        ("name: 12", "1:7: name: is 12, expected text in quotes"),
        ("name:", "1:6: name: is empty, expected text"),
        ("name: a\nseed: true", "2:7: seed: is true, expected a whole number of at least 0"),
        ("name: a\nseed: '3'", "2:7: seed: is '3', expected a whole number of at least 0"),
        ("name: a\nseed: 1.5", "2:7: seed: is 1.5, expected a whole number of at least 0"),
        ("name: a\nseed: -1", "2:7: seed: is -1, expected a whole number of at least 0"),
        ("name: a\nseed: [1]", "2:7: seed: is a list, expected a whole number of at least 0"),
        ("name: a\nmode: fats", "2:7: mode: is 'fats', expected 'fast' or 'slow' (did you mean 'fast'?)"),
        ("name: a\nsize: [1]", "2:7: size[1]: missing, expected a number"),
        ("name: a\nsize: [1, .nan]", "2:11: size[1]: is .nan, expected a finite number"),
        ("name: a\nsize: [1, 1e999]", "2:11: size[1]: is 1e999, expected a finite number"),
        ("name: a\nplaces: 4", "2:9: places: is 4, expected a list of mappings"),
        ("name: a\nseeds: []", "2:1: seeds: unknown key, expected " + KEYS + " or note (did you mean 'seed'?)"),
        ("name: a\nsize: 4", "2:7: size: is 4, expected a list of 2: a number, a number"),
        (
            "name: a\nplaces: [{kind: dics}]",
            "2:17: places[0].kind: is 'dics', expected 'disc' or 'grid' (did you mean 'disc'?)",
        ),
        (
            "name: a\nplaces: [{radius: 1}]",
            "2:10: places[0].kind: missing, expected 'disc' or 'grid' (did you mean kind: disc and radius?)",
        ),
        ("name: a\nplaces: [3]", "2:10: places[0]: is 3, expected a mapping with kind: 'disc' or 'grid'"),
        (
            "name: a\nplaces:\n- {kind: disc, radius: 1, share: 2}",
            "3:34: places[0].share: is 2, expected a number from 0 to 1",
        ),
        ("name: a\neither: {kind: disc, radius: 0}", "2:30: either.radius: is 0, expected a number above 0"),
        (
            "name: a\neither: {kind: disk}",
            "2:16: either.kind: is 'disk', expected 'disc' or 'grid' (did you mean 'disc'?)",
        ),
        ("name: a\nnamed: {x: {kind: grid, flat: yes}}", "2:31: named.x.flat: is 'yes', expected true or false"),
        ("name: a\nnamed: {3: {kind: grid}}", "2:9: named: a key is 3, which is no text, expected text in quotes"),
        ("name: a\nnamed: {~: {kind: grid}}", "2:9: named: a key is empty, expected text"),
        ("name: a\nnamed: {[1]: {kind: grid}}", "2:9: named: a key is a list or mapping, expected text"),
        (
            "name: a\nduration: x",
            "2:11: duration: is 'x', expected a whole number of at least 1 or a mapping with seconds",
        ),
        ("name: a\nduration: 0", "2:11: duration: is 0, expected a whole number of at least 1"),
        ("name: a\nduration: {seconds: -1}", "2:21: duration.seconds: is -1, expected a number above 0"),
        ("name: a\n seed: 3", "2:2: wrong indentation of 1 space, expected 0 as in line 1"),
        (
            "named:\n    x: {kind: grid}\n  y: {kind: grid}",
            "3:3: wrong indentation of 2 spaces, expected 4 as in line 2 or 0 as in line 1",
        ),
        (
            "# comment\nplaces:\n- kind: grid\n\n   columns: 3",
            "5:4: wrong indentation of 3 spaces, expected 2 as in line 3 or 0 as in line 3",
        ),
        (
            "named:\n  x:\n    kind: grid\n   flat: true",
            "4:4: wrong indentation of 3 spaces, expected 4 as in line 3, 2 as in line 2 or 0 as in line 1",
        ),
        (
            "note: a fight: the end",
            "1:14: broken YAML: a second ':' in a value, expected quotes around text that holds ': '",
        ),
        ("name: a\nseed 5\nmode: fast", "2:1: broken YAML: 'seed 5' has no ':', expected KEY: VALUE"),
        ("name:a\nseed: 5", "1:6: broken YAML: no blank after the ':', expected KEY: VALUE"),
        ("places:\n - kind: grid\n name: a", "3:2: broken YAML: a key among the items of a list, expected '- '"),
        ("named:\n  x: {kind: grid}\n  - y", "3:3: broken YAML: a list item among keys, expected KEY: VALUE"),
        ("name: a\nsize: [1, 2, 3]", "2:7: size: has 3 items, expected a list of 2: a number, a number"),
        (
            "name: a\nduration: {second: 2}",
            "2:12: duration.second: unknown key, expected seconds (did you mean 'seconds'?)",
        ),
        (
            "name: a\nplaces: [{knd: disc, radius: 1}]",
            "2:11: places[0].knd: unknown key, expected kind: 'disc' or 'grid' (did you mean 'kind'?)",
        ),
        (
            "name: a\neither: {knid: disc, radius: 1}",
            "2:10: either.knid: unknown key, expected kind: 'disc' or 'grid' (did you mean 'kind'?)",
        ),
        (
            "name: a\nnote: #ff0000",
            "2:6: note: is empty, since # begins a comment where '#ff0000' has no quotes, expected text",
        ),
        ("name: a\nnoet:", f"2:1: noet: unknown key, expected {KEYS} or note (did you mean 'note'?)"),
        ("name: a\nnote: ~", "2:7: note: is null, expected text"),
        ("name: a\nplaces:\n-", "3:2: places[0]: is empty, expected a mapping with kind: 'disc' or 'grid'"),
        (
            "name: a\nplaces: [{radus: 1}]",
            "2:10: places[0].kind: missing, expected 'disc' or 'grid' (did you mean kind: disc and radius?)",
        ),
        ("name: a\nloop: fast", "2:1: loop: unknown key, it is now called 'mode'"),
        ("title: a", "1:1: title: unknown key, it is now called 'name'"),
        ("nmae: a", f"1:1: nmae: unknown key, expected {KEYS} or note (did you mean 'name'?)"),
        ("name: a\nduration: [.nan]", "2:12: duration[0]: is .nan, expected a finite number"),
        (
            'name: "\\U99999999"',
            "1:10: broken YAML: while parsing a quoted scalar: found invalid Unicode character escape code",
        ),
        ("name: [", "1:8: broken YAML: while parsing a flow node: expected the node content, but found '<stream end>'"),
        (
            "name: a\n\tseed: 3",
            "2:1: broken YAML: while scanning for the next token: found character '\\t' that cannot start any token; "
            "indent with spaces, not with tabs",
        ),
        ("name: *who", "1:7: broken YAML: found undefined alias 'who'"),
        ("name: a\n---\nname: b", "2:1: another document begins, expected a single one in the file"),
        (
            "name: !!python/object/apply:os.system ['true']",
            "1:7: name: the tag '!!python/object/apply:os.system' is not allowed, expected a plain value",
        ),
        ("name: !secret x", "1:7: name: the tag '!secret' is not allowed, expected a plain value"),
        ("name: a\nnamed: &n {x: *n}", "2:8: named.x: refers to itself, expected a value"),
        ("[" * 3000, "1:66: nested too deeply, expected at most 64 levels"),
        ("[" * 90 + "]" * 90, "1:66: nested too deeply, expected at most 64 levels"),
        (b"name: a\nnote: \xff", "2:7: byte 0xff is no UTF-8, expected a text file in UTF-8"),
        ("name: a\nnote: \x07", "2:7: broken YAML: the character U+0007 is not allowed"),
        ("#" * 1_048_577, "1:1: the file is too large, expected at most 1,048,576 bytes"),
    ],
)
def test_each_mistake_is_one_line_with_position_and_expectation(write, text, expected):
    assert findings(write(text)) == [f"show.yaml:{expected}"]


def test_all_findings_of_a_file_come_at_once_in_the_order_of_its_lines(write):
    path = write("""\
sede: 3
name: 7
places:
  - {kind: disc}
  - {kind: disc, radius: -1, colums: 3}
note: nobody
duration: soon
duration: later
""")
    assert findings(path) == [
        f"show.yaml:1:1: sede: unknown key, expected {KEYS} or note (did you mean 'seed'?)",
        "show.yaml:2:7: name: is 7, expected text in quotes",
        "show.yaml:4:5: places[0].radius: missing, expected a number above 0",
        "show.yaml:5:26: places[1].radius: is -1, expected a number above 0",
        "show.yaml:5:30: places[1].colums: unknown key, expected kind, radius or share",
        "show.yaml:6:7: note: is 'nobody', expected somebody",
        "show.yaml:7:11: duration: is 'soon', expected a whole number of at least 1 or a mapping with seconds",
        "show.yaml:8:1: duration: duplicate key, expected it once; it is already in line 7",
    ]


def test_findings_of_validators_are_at_their_keys_or_the_nearest_above(write):
    assert findings(write("name: a\nseed: 13")) == [
        "show.yaml:1:1: named.x: has no friend",
        "show.yaml:2:7: seed: is 13, expected luck",
    ]


def test_aliases_that_blow_up_end_early(write):
    lines = ["name: a", "a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 12)]
    found = findings(write("\n".join(lines)))
    assert len(found) == 1
    assert "the file unfolds to more than 100,000 values, expected fewer aliases" in found[0]
    merges = ["a0: &a0 {}", *[f"a{i}: &a{i} {{<<: [{', '.join([f'*a{i - 1}'] * 9)}]}}" for i in range(1, 12)]]
    assert "unfolds to more than 100,000 values" in findings(write("\n".join(merges)))[0]


def test_files_that_cannot_be_read_are_findings(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert findings("gone.yaml") == ["gone.yaml: no such file"]
    assert findings(".") == [".: is a folder, expected a YAML file"]
    assert findings("a\0b") == ["a\0b: cannot be read: embedded null byte"]


def test_numbers_are_those_of_yaml_1_2_and_words_stay_words(write):
    path = write("name: yes\nseed: 1e3\nsize: [1_000, -.5e1]\nnote: 12:30\nduration: 0x10\n")
    show = load_model(path, Show, RecipeError)
    assert (show.name, show.seed, show.size, show.note, show.duration) == ("yes", 1000, (1000.0, -5.0), "12:30", 16)
    assert isinstance(show.size[0], float)


def test_merge_keys_fill_in_what_a_mapping_does_not_say(write):
    path = write("name: a\nplaces:\n- &d {kind: disc, radius: 2, share: 0.25}\n- {<<: *d, radius: 3}\n")
    assert load_model(path, Show, RecipeError).places[1] == Disc(kind="disc", radius=3, share=0.25)


def test_own_keys_override_merged_ones_and_earlier_merges_later_ones(write):
    text = "a: &a {x: 1, y: 1, z: 1}\nb: &b {z: 2, w: 2}\nc: {<<: [*a, *b], y: 3, v: 3}\n"
    data = read_document(text.encode(), "x").data["c"]
    assert data == {"y": 3, "v": 3, "x": 1, "z": 1, "w": 2}
    assert list(data) == ["y", "v", "x", "z", "w"]
    chain = "".join(f"a{i}: &a{i} {{<<: *a{i - 1}}}\n" for i in range(1, 2000))
    found = read_document(f"a0: &a0 {{}}\n{chain}".encode(), "x").findings
    assert [finding.message for finding in found] == ["nested too deeply, expected at most 64 levels"]


def test_the_error_has_every_finding_in_a_line_of_its_own(write):
    with pytest.raises(RecipeError) as caught:
        load_model(write("seed: x\nmode: 3"), Show, RecipeError)
    assert str(caught.value).split("\n") == [str(finding) for finding in caught.value.findings]
    assert [finding.key for finding in caught.value.findings] == ["name", "seed", "mode"]


GOOD = "name: a\nplaces: [{kind: disc, radius: 1}]\n"


def test_overrides_are_typed_by_the_schema(write):
    path = write(GOOD)
    sets = ["name=12", "places[0].radius=2", "places.0.share=.25", "seed=1e3", "duration.seconds=1", "size=[3, 4]"]
    show = load_model(path, Show, RecipeError, [*sets, "named.x={kind: grid, flat: true}", "note=true", "mode=slow"])
    assert show.name == "12"
    assert show.places[0] == Disc(kind="disc", radius=2, share=0.25)
    assert (show.seed, show.size, show.duration, show.note) == (1000, (3.0, 4.0), Seconds(seconds=1), "true")
    assert show.named["x"].flat is True
    assert load_model(path, Show, RecipeError, ["mode=slow", "mode=null"]).mode is None
    assert load_model(path, Show, RecipeError, ["note=#ff0000"]).note == "#ff0000"
    assert load_model(path, Show, RecipeError, ["name='null'", "duration=5", "duration.seconds=2"]).name == "null"


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("loop=fast", "loop: unknown key, it is now called 'mode'"),
        ("sede=3", f"sede: unknown key, expected {KEYS} or note (did you mean 'seed'?)"),
        ("seed=many", "seed: is 'many', expected a whole number of at least 0"),
        ("seed=true", "seed: is true, expected a whole number of at least 0"),
        ("seed=", "seed: is empty, expected a whole number of at least 0"),
        ("note=", "note: is empty, expected text"),
        ("note=null", "note: is null, expected text"),
        ("seed=.inf", "seed: is .inf, expected a finite number"),
        (
            "seed=!!python/name:os.system x",
            "seed: the tag '!!python/name:os.system' is not allowed, expected a plain value",
        ),
        ("places[1].radius=3", "places: there is no item 1, expected an index from 0 to 0"),
        ("places.x.radius=3", "places: there is no item x, expected an index from 0 to 0"),
        ("places.0.radios=3", "places[0].radios: unknown key, expected kind, radius or share (did you mean 'radius'?)"),
        ("named.0.colums=3", "named.0.colums: unknown key, expected kind, columns or flat (did you mean 'columns'?)"),
        ("size[0]=3", "size: there is no item 0, expected none: the list is empty"),
        ("name.x=3", "name.x: name is 'a', expected a mapping"),
        (
            "places=[",
            "places: broken YAML: while parsing a flow node: expected the node content, but found '<stream end>'",
        ),
        ("seed", "is no override, expected KEY=VALUE, such as seed=3 or groups[0].count=12"),
        ("=3", "is no override, expected KEY=VALUE, such as seed=3 or groups[0].count=12"),
        ("places[a]=3", "is no override, expected KEY=VALUE, such as seed=3 or groups[0].count=12"),
    ],
)
def test_a_wrong_override_is_a_finding_that_names_it(write, override, expected):
    assert findings(write(GOOD), override) == [f"--set {override}: {expected}"]


def test_findings_are_placed_at_their_key_or_the_nearest_above_it(write):
    path = write(GOOD)
    found = [Finding(("places", 0, "radius"), "is odd"), Finding(("places", 0, "share"), "is missed")]
    assert [str(finding) for finding in place(path, found)] == [
        "show.yaml:2:31: places[0].radius: is odd",
        "show.yaml:2:10: places[0].share: is missed",
    ]
    assert str(place("gone.yaml", found)[0]) == "gone.yaml: places[0].radius: is odd"


plain = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**53), 2**53)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(alphabet=st.characters(codec="utf-8", exclude_categories=("Cs", "Cc", "Co", "Cn")), max_size=12)
    | st.sampled_from(["1e3", "yes", "~", "0o7", "1_0", ".nan", "null", "12:30", "<<", "=", "- a", "a: b", "\n", "'"]),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text("abc1e_", min_size=1, max_size=3), inner, max_size=3)
    ),
    max_leaves=8,
)


@given(st.dictionaries(st.sampled_from(["a", "b", "1e3", "yes"]), plain, min_size=1))
def test_what_is_dumped_is_read_back_the_same(data):
    document = read_document(dump_yaml(data).encode(), "x")
    assert document.findings == []
    assert document.data == data


@given(st.text(alphabet="ab:-[]{}&*!'\"#|>%@\t\n ,?01.e~<", max_size=40))
def test_any_text_gives_a_model_or_findings_of_one_line_each(text):
    for finding in read_document(text.encode(), "x").findings:
        assert re.fullmatch(r"x:\d+:\d+: .+", str(finding))


def test_pyyaml_agrees_on_what_is_plain():
    text = "a: 1\nb: [x, 2.5, true, null]\nc: {d: 'e', f: -3}\n"
    assert read_document(text.encode(), "x").data == yaml.safe_load(text)
