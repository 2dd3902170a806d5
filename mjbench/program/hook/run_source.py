"""Run a program from another file: `python run_source.py SOURCE PROGRAM [ARGS]…`.

The program sees its own name, folder and arguments, as if it were run itself.
"""

import os
import sys
from typing import Any


def main() -> None:
    source, program, *arguments = sys.argv[1:]
    sys.argv[:] = [program, *arguments]
    sys.path[0] = os.path.dirname(os.path.abspath(program))
    with open(source, "rb") as file:
        code = compile(file.read(), program, "exec")
    names: dict[str, Any] = sys.modules["__main__"].__dict__
    for name in [name for name in names if not name.startswith("__")]:
        del names[name]
    names.update(__file__=program, __doc__=None)
    exec(code, names)


if __name__ == "__main__":
    main()
