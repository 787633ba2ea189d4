"""Native code runs in a process of its own: if it crashes or hangs on a mesh, the batch goes on."""

import multiprocessing
import signal
import traceback
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

from palpate.batch import UnusableObject, lacks_memory, require_memory


def isolated(function: Callable[..., Any], *arguments: Any, seconds: float) -> Any:
    """Call the function in a forked child process and return its (picklable) result. Raises `UnusableObject` if it
    does, crashes or takes more than `seconds` (a pause of both processes counts as 1 s at most); OSError or MemoryError
    if it does, also in a library's own words, else RuntimeError, with its traceback; MemoryError too if killed."""
    context = multiprocessing.get_context("fork")  # no second start of Python and its libraries
    receiver, sender = context.Pipe(duplex=False)
    child = context.Process(target=_answer, args=(sender, function, arguments), daemon=True)
    child.start()
    sender.close()
    parts = max(1, round(seconds))
    try:
        if not any(receiver.poll(seconds / parts) for _ in range(parts)):
            raise UnusableObject(f"took more than {seconds:g} s: simplify the mesh")
        error, answer = receiver.recv()
    except EOFError:
        child.join()
        code = child.exitcode
        if code == -signal.SIGKILL:
            raise MemoryError(
                "the process that prepares the mesh was killed, perhaps because memory ran out: run with "
                "fewer cores, or remove the object"
            ) from None
        end = signal.Signals(-code).name if code is not None and code < 0 else f"exit status {code}"
        require_memory(f"a mesh library crashed ({end})")
        raise UnusableObject(f"a mesh library crashed on it ({end}): clean or simplify the mesh") from None
    finally:
        child.kill()
        child.join()
        receiver.close()
    if error is not None:
        raise error(answer)
    return answer


def _answer(sender: Connection, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
    """Send the class of the error to raise, or None, and its message, or the result."""
    message: tuple[type[Exception] | None, Any]
    try:
        message = None, function(*arguments)
    except UnusableObject as error:
        message = UnusableObject, str(error)
    except Exception as error:
        kind = MemoryError if lacks_memory(error) else OSError if isinstance(error, OSError) else RuntimeError
        message = kind, f"in the process that prepares the mesh:\n{traceback.format_exc()}"
    sender.send(message)
    sender.close()
