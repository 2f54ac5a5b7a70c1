"""Code that a file names runs if the user agreed, and else not at all."""

import contextlib
import importlib.util
import marshal
import os
import shutil
import sys
import time
import types
from pathlib import Path

import pytest

from ravenjax import consent, robots
from ravenjax.campaign import compile_cache, loading
from ravenjax.campaign.file import own_part
from ravenjax.errors import UserError
from ravenjax.train import processes

CAMPAIGN = """
[campaign]
name = "own"
[[detector]]
name = "own"
file = "FILE"
threshold = [1]
[[group]]
name = "fault-free"
"""


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A campaign with a part that imports a module; both leave a file when they run."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    (tmp_path / "campaign").mkdir()
    for folder in (tmp_path, tmp_path / "campaign"):
        (folder / "beside.py").write_text(
            f"open({str(tmp_path / 'ran')!r}, 'a').write('beside ')\n"
        )
        (folder / "part.py").write_text(
            f"open({str(tmp_path / 'ran')!r}, 'a').write('part ')\nimport beside\n"
            "def step(params, state, view):\n    return state, view.tip_error\n"
        )
    for name, file in (("own", "part.py"), ("outside", "../part.py")):
        (tmp_path / "campaign" / f"{name}.toml").write_text(CAMPAIGN.replace("FILE", file))
    return tmp_path


def test_a_computed_campaign_runs_the_code_in_its_folder_and_later_files_what_ran_before(
    place, monkeypatch
):
    campaign = place / "campaign" / "own.toml"
    with pytest.raises(UserError, match=r"part.py: this Python file was not run.*--trust"):
        loading.load_campaign(campaign, runs=False)
    with pytest.raises(UserError, match="this Python file was not run"):
        loading.load_campaign(campaign.with_name("outside.toml"))
    assert not (place / "ran").exists()
    # A name without a folder means the current one.
    monkeypatch.chdir(campaign.parent)
    config = loading.load_campaign(campaign.name)
    assert (place / "ran").read_text() == "part beside "
    own_part._READ_FILES.clear()
    assert loading.validate_tables(config.model_dump(mode="json")).detectors
    (place / "campaign" / "beside.py").write_text("raise RuntimeError")
    own_part._READ_FILES.clear()
    with pytest.raises(UserError, match=r"beside.py: this Python file was not run"):
        loading.validate_tables(config.model_dump(mode="json")).detectors  # noqa: B018


def test_trust_lets_any_code_run(place, monkeypatch):
    monkeypatch.setenv(consent.VARIABLE, "1")
    loading.load_campaign(place / "campaign" / "outside.toml", runs=False)
    assert (place / "ran").exists()


def test_code_of_another_user_is_not_the_users_own(place, monkeypatch):
    monkeypatch.setattr(consent, "OWNERS", (os.geteuid() + 1,))
    with pytest.raises(UserError, match="owned by another user"):
        loading.load_campaign(place / "campaign" / "own.toml")


def test_a_result_imports_no_module_as_its_robot(tmp_path, monkeypatch):
    (tmp_path / "lab").mkdir()
    ran = f"open({str(tmp_path / 'ran')!r}, 'w')\n"
    for name in ("__init__", "strange"):
        (tmp_path / "lab" / f"{name}.py").write_text(ran)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))

    def find_robot(told):
        with pytest.raises(UserError, match=told):
            robots.find_robot("lab.strange")
        imported = [name for name in ("lab", "lab.strange") if sys.modules.pop(name, None)]
        assert (tmp_path / "ran").exists() == bool(imported)

    find_robot(r"strange.py: this Python file was not run")
    with consent.trust_folders(tmp_path):
        find_robot("has no variable ROBOT")
    find_robot("has no variable ROBOT")
    # What ran before was another package.
    (tmp_path / "ran").unlink()
    (tmp_path / "lab" / "__init__.py").write_text(f"{ran}# changed\n")
    find_robot(r"strange.py: this Python file was not run")


def test_a_robot_beside_its_campaign_is_found(tmp_path, monkeypatch):
    """So are the modules beside it that it imports, and no others."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setattr(sys, "meta_path", sys.meta_path.copy())
    module = Path(__file__).parent / "robots" / "planar_arm.py"
    arm = tmp_path / "beside_arm.py"
    arm.write_text("import beside_gains\n" + module.read_text())
    shutil.copy(module.with_suffix(".xml"), tmp_path / "beside_arm.xml")
    (tmp_path / "beside_gains.py").write_text("import beside_nothing")
    (tmp_path / "beside_strange.py").touch()
    campaign = tmp_path / "own.toml"
    text = '[campaign]\nname = "x"\nrobot = "beside_arm"\n[[group]]\nname = "free"\n'
    campaign.write_text(text.replace("side_arm", "side_am"))
    with pytest.raises(UserError, match=f"is unknown: .* No such module is in {tmp_path}, "):
        loading.load_campaign(campaign)
    campaign.write_text(text)
    with pytest.raises(UserError, match=r"beside_arm.py: this Python file was not run"):
        loading.load_campaign(campaign, runs=False)
    for error in ("ModuleNotFoundError: No module named 'beside_nothing'", "SyntaxError"):
        with pytest.raises(UserError, match=f"beside_arm.py cannot be imported: {error}"):
            loading.load_campaign(campaign)
        (tmp_path / "beside_gains.py").write_text("KP = (")
    (tmp_path / "beside_gains.py").write_text("KP = 1")
    # Bytecode is not what the user agreed to.
    forged = compile(f"open({str(tmp_path / 'ran')!r}, 'w')", str(arm), "exec")
    cached = Path(importlib.util.cache_from_source(str(arm)))
    cached.parent.mkdir()
    unchecked = importlib.util.MAGIC_NUMBER + (1).to_bytes(4, "little") + bytes(8)
    cached.write_bytes(unchecked + marshal.dumps(forged))
    assert loading.load_campaign(campaign).robot.title == "beside_arm.xml"
    assert not (tmp_path / "ran").exists()
    assert importlib.util.find_spec("beside_strange") is None


def test_a_user_without_a_home_has_no_cache(monkeypatch, tmp_path):
    def no_home():
        raise RuntimeError

    monkeypatch.delenv(compile_cache.VARIABLE, raising=False)
    monkeypatch.setattr(consent.Path, "home", no_home)
    for given in ("", "relative"):
        monkeypatch.setenv("XDG_CACHE_HOME", given)
        assert compile_cache.object_cache() is None
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert compile_cache.object_cache() is not None
    assert (tmp_path / "ravenjax").stat().st_mode & 0o777 == 0o700


def test_a_cache_that_others_may_change_is_refused(monkeypatch, tmp_path):
    monkeypatch.setenv(compile_cache.VARIABLE, str(tmp_path))
    assert consent.is_private(tmp_path)
    (tmp_path / "foreign").touch()
    lstat = consent.Path.lstat
    monkeypatch.setattr(
        consent.Path, "lstat", lambda path: types.SimpleNamespace(st_uid=lstat(path).st_uid + 1)
    )
    assert not consent.is_private(tmp_path)
    (tmp_path / "foreign").unlink()
    tmp_path.chmod(0o770)
    with pytest.raises(UserError, match=r"other users can write into this cache.*chmod go-w"):
        compile_cache.object_cache()


def test_a_process_imports_nothing_from_the_current_folder(monkeypatch, tmp_path):
    (tmp_path / "pickle.py").write_text("open('ran', 'w')")
    monkeypatch.chdir(tmp_path)
    with contextlib.ExitStack() as stack:
        process = processes.spawn_process(stack, time.sleep, 0)
        process.join()
    assert process.exitcode == 0 and not (tmp_path / "ran").exists()
