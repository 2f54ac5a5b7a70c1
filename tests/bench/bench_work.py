"""What stands in for parts of a benchmark; light, as each process that runs one imports it."""

from __future__ import annotations

import os
import subprocess
import sys
import time


def describe():
    return {"gpus": [], "no_gpu": "no GPU"}


def describe_three_gpus():
    return {"gpus": ["a GPU"] * 3, "no_gpu": ""}


def answers(seconds, *arguments):
    print("what it prints is no answer")
    return [{"seconds": seconds, "arguments": list(arguments)}]


def ends_without_an_answer(seconds):
    os._exit(9)


def raises(seconds):
    raise RuntimeError("out of memory")


def sleeps(seconds, file=""):
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    if file:
        with open(file, "w") as text:
            text.write(str(child.pid))
    time.sleep(60.0)


def environment(seconds):
    names = ("RAVENJAX_CACHE", "CUDA_VISIBLE_DEVICES")
    return [{name: os.environ.get(name) for name in names}]
