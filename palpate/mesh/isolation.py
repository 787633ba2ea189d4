"""Running native code on meshes from anywhere: a crash or a hang of it must not take the batch along."""

import multiprocessing
import signal
import traceback
from collections.abc import Callable
from typing import Any

from palpate.catalogue.batch import Unusable


def isolated(function: Callable[..., Any], *arguments: Any, seconds: float) -> Any:
    """Call the function in a forked child process and return its (picklable) result.

    Raises `Unusable` if it does, if the child dies (segmentation fault, out of memory) or takes more than
    `seconds`; raises RuntimeError with the child's traceback for any other exception.
    """
    context = multiprocessing.get_context("fork")  # no second start of Python and its libraries
    receiver, sender = context.Pipe(duplex=False)
    child = context.Process(target=_answer, args=(sender, function, arguments), daemon=True)
    child.start()
    sender.close()
    try:
        if not receiver.poll(seconds):
            raise Unusable(f"took more than {seconds:g} s: simplify the mesh, or raise the time limit")
        kind, answer = receiver.recv()
    except EOFError:
        child.join()
        raise Unusable(
            f"a mesh library crashed on it ({_death(child.exitcode)}): clean or simplify the mesh"
        ) from None
    finally:
        child.kill()
        child.join()
        receiver.close()
    if kind == "unusable":
        raise Unusable(answer)
    if kind == "error":
        raise RuntimeError(f"in the process that prepares the mesh:\n{answer}")
    return answer


def _answer(sender, function, arguments):
    try:
        message = "result", function(*arguments)
    except Unusable as error:
        message = "unusable", str(error)
    except Exception:
        message = "error", traceback.format_exc()
    sender.send(message)
    sender.close()


def _death(code):
    if code is not None and code < 0:
        return signal.Signals(-code).name
    return f"exit status {code}"
