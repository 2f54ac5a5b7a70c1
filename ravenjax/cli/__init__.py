"""The command line `ravenjax`. Each command imports slow modules only when it runs."""

import gc
import logging
import os
import pkgutil
import sys

from cyclopts import App, CycloptsError

import ravenjax
from ravenjax.cli import console

USER_ERROR, INTERRUPTED = 2, 130
"""Exit codes for bad input and for Ctrl-C."""

COMMANDS = """
    running:run running:check running:fault_free results:report explaining:trace explaining:explain
    deadlines:deadline exporting:explore monitors:counterfactual results:verify results:compare
    gating:gate covering:coverage results:merge machine:evidence monitors:monitor running:search
    machine:reproduce machine:credibility motion:motion motion:calibrate training:train
    training:robot training:play training:study training:log exporting:export catalogue:campaigns
    catalogue:faults catalogue:parameters exporting:schema machine:bench machine:doctor
"""
"""Module and name of each command, in the order of the reference."""

app = App(
    name="ravenjax",
    help=(
        "Fault injection for a virtual Raven-II surgical robot, with thousands of runs in"
        " parallel.\n\nEvery command has the option `--trust`. It permits Python code that a"
        " campaign or a result folder names, although you have not run this code before."
    ),
    version=ravenjax.__version__,
    suppress_keyboard_interrupt=False,
)
for _command in COMMANDS.split():
    app.command(pkgutil.resolve_name(f"ravenjax.cli.{_command}"))
app.register_install_completion_command(
    help="Install completion of commands, options and files for this shell (bash, zsh, fish)."
)


def main(tokens: list[str] | None = None) -> int:
    """Run the command that `tokens` (default: sys.argv) name, and return the exit code.

    For an error that the user can correct, print one message and return 2.
    """
    from ravenjax import consent
    from ravenjax.errors import StoreError, UserError, require_utf8

    # Nearly all objects of a command live until its end, so garbage collections free little
    # memory. They are therefore made rare: by default every 700 new objects start a collection.
    gc.set_threshold(100_000, 50, 100)
    arguments = sys.argv[1:] if tokens is None else tokens
    trusted_folders = [consent.EVERYWHERE] if "--trust" in arguments else []
    # Without this variable, MuJoCo starts a process that looks for a display.
    os.environ.setdefault("MUJOCO_GL", "disable")
    # Without a home folder, matplotlib would print where it stores its fonts.
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    try:
        require_utf8(*arguments, os.getcwd())
        with consent.trust_folders(*trusted_folders):
            result = app(
                [argument for argument in arguments if argument != "--trust"],
                exit_on_error=False,
                print_error=True,
                result_action="return_value",
            )
    except KeyboardInterrupt:
        console.print_text(
            "stopped; finished results are kept, and the same command continues", console.err
        )
        return INTERRUPTED
    except SystemExit as exit_request:
        return exit_request.code if isinstance(exit_request.code, int) else 1
    except CycloptsError:
        # The parser has already printed what is wrong with the command line.
        return USER_ERROR
    except (UserError, StoreError) as error:
        console.print_error(f"error: {error}")
        return USER_ERROR
    # Only commands with an exit code of their own return a number.
    return result if isinstance(result, int) else 0
