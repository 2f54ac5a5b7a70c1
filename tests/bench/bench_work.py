"""What stands in for parts of a benchmark; light, as each process that runs one imports it."""

import os
import time


def describe():
    return {"gpus": [], "no_gpu": "no GPU"}


def answers(seconds, *arguments):
    print("what it prints is no answer")
    return [{"seconds": seconds, "arguments": list(arguments)}]


def ends_without_an_answer(seconds):
    os._exit(9)


def raises(seconds):
    raise RuntimeError("out of memory")


def sleeps(seconds):
    time.sleep(60.0)
