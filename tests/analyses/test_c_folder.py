"""The C library: compiled and run, with the bits of Python's; what it leans on; what happens
without a compiler.
"""

import shutil
import subprocess

import numpy as np
import pytest
from closed_loop import drive

import ravenjax as rj
from ravenjax.analyses import c_folder
from ravenjax.cli import main
from ravenjax.errors import UserError

needs_cc = pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    return c_folder.write_library(tmp_path_factory.mktemp("c"))


def lines(written, *flags):
    """What the example prints."""
    folder = written.example.parent
    words = [
        "cc",
        "-std=c11",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-O2",
        "example.c",
        *flags,
        "-lm",
        "-o",
        "example",
    ]
    subprocess.run(words, cwd=folder, check=True)
    return subprocess.run(
        ["./example"], cwd=folder, check=True, capture_output=True, text=True
    ).stdout.splitlines()


def expected(cycles=3000, **software):
    """The same of Python's."""
    own = rj.ControlSoftware(**software)
    for ms, (output, reading) in enumerate(
        drive(own, rj.VirtualRobot(own.setup.arms, own.setup.tools), cycles)
    ):
        pairs = zip(np.ravel(output.dac).tolist(), reading.encoders.ravel().tolist(), strict=True)
        numbers = [ms, int(reading.signals.runlevel), *(n for pair in pairs for n in pair)]
        yield " ".join([*map(str, numbers), *(f"{x:.9g}" for x in reading.signals.tip[0])])


@pytest.mark.slow
@needs_cc
def test_the_example_has_pythons_bits(written):
    found = lines(written, "-L.", "-lravenjax_raven2", "-Wl,-rpath,.")
    assert len(written.example.read_text().splitlines()) <= 60
    assert found == list(expected())
    assert len({line.split(" ", 2)[2] for line in found}) > 2000  # it moves


@pytest.mark.slow
@needs_cc
def test_native_code_of_one_arm_linked_as_an_object(tmp_path):
    own = rj.ControlSoftware(arms=["green"], policy="hard_regulation")
    written = c_folder.write_library(tmp_path, own, cpu="native")
    assert lines(written, "ravenjax_raven2.o") == list(
        expected(arms=["green"], policy="hard_regulation")
    )


@pytest.mark.slow
@needs_cc
def test_both_go_on_from_where_they_stand(tmp_path):
    software, robot = rj.ControlSoftware(), rj.VirtualRobot()
    rest = [f"{ms} {line.split(' ', 1)[1]}" for ms, line in enumerate(expected(450)) if ms >= 150]
    for _ in drive(software, robot, 150):
        pass
    written = c_folder.write_library(tmp_path, software, robot)
    text = written.example.read_text().replace("ms = 0; ms < 3000", "ms = 150; ms < 450")
    written.example.write_text(text)
    assert lines(written, "ravenjax_raven2.o") == rest


@pytest.mark.slow
def test_what_is_wrong_is_one_line(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    for words, part in (
        ([str(tmp_path / "file")], "is a file, expected a folder"),
        ([str(tmp_path), "--arms", "red"], "arm is 'red'"),
        ([str(tmp_path), "--parameter-set", "steel"], "parameter_set is 'steel'"),
    ):
        assert main(["export", *words]) == 2
        assert part in capsys.readouterr().err
    with pytest.raises(UserError, match="expected the same"):
        c_folder.write_library(
            tmp_path, rj.ControlSoftware(arms=["gold"]), rj.VirtualRobot(arms=["green"])
        )
    with pytest.raises(UserError, match="cpu is 'fast', expected one of portable, native"):
        c_folder.write_library(tmp_path, cpu="fast")
    with pytest.raises(UserError, match="absolute"):
        c_folder.write_library(tmp_path, rj.ControlSoftware("fork2015", console="absolute"))
