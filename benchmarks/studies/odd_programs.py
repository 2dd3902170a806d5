"""Small programs that depend on what most programs never look at.

That is how they end, how they were started, and which objects MuJoCo's functions are. Each
prints what it sees; nothing in it varies from run to run. `same_behaviour` runs them.
"""

import signal
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

_STEPS = """
import mujoco
model = mujoco.MjModel.from_xml_string(
    "<mujoco><worldbody><body><joint/><geom size='.1'/></body></worldbody></mujoco>"
)
data = mujoco.MjData(model)
for _ in range(300):
    mujoco.mj_step(model, data)
print(round(data.time, 3))
"""
_WORKERS = """
import multiprocessing
import mujoco

def work(count):
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    data = mujoco.MjData(model)
    for _ in range(count):
        mujoco.mj_step(model, data)
    return round(data.time, 3)

if __name__ == "__main__":
    context = multiprocessing.get_context("{method}")
    with context.Pool(2) as pool:
        print(pool.map(work, [10, 300]))
    process = context.Process(target=exit, args=(7,))
    process.start()
    process.join()
    print(process.exitcode)
"""


@dataclass(frozen=True)
class OddProgram:
    """A program.

    Attributes:
      text: content of `program.py`.
      arguments: of Python, before the program's own.
      signal_number: signal after the first line of output; None for none.
      closes_output: whether nobody reads the output.
    """

    text: str | bytes
    arguments: Sequence[str] = ("program.py", "one", "--two")
    stdin: str = ""
    signal_number: int | None = None
    closes_output: bool = False
    environment: Mapping[str, str] = field(default_factory=dict)
    files: Mapping[str, str] = field(default_factory=dict)


_PACKAGE = {
    "package/__init__.py": "print('package', __name__)",
    "package/__main__.py": "from . import part\nfrom .part import name\nprint(name, __package__)",
    "package/part.py": "name = __name__",
}
ODD_PROGRAMS: Mapping[str, OddProgram] = {
    # How a program ends
    "exit code": OddProgram(_STEPS + "import sys; sys.exit(3)"),
    "exit with a text": OddProgram(_STEPS + "import sys; sys.exit('stopped')"),
    "exit without a value": OddProgram("raise SystemExit"),
    "exit with a large code": OddProgram("raise SystemExit(-1)"),
    "exit at once": OddProgram(_STEPS + "import os, sys; sys.stdout.flush(); os._exit(5)"),
    "uncaught exception": OddProgram(
        _STEPS + "def f():\n    try:\n        1 / 0\n    except ZeroDivisionError as error:\n"
        "        raise ValueError('no') from error\nf()"
    ),
    "wrong arguments of the engine": OddProgram(_STEPS + "mujoco.mj_step(1, 2)"),
    "too few arguments of the engine": OddProgram(_STEPS + "mujoco.mj_step(model)"),
    "unknown keyword of the engine": OddProgram(
        _STEPS + "try:\n    mujoco.mj_step(model, data, steps=2)\n"
        "except TypeError as error:\n    print('steps' in str(error))"
    ),
    "wrong model": OddProgram(
        "import mujoco\ntry:\n    mujoco.MjModel.from_xml_string('<mujoco')\n"
        "except ValueError as error:\n    print(error)\nmujoco.MjModel.from_xml_path('none.xml')"
    ),
    "syntax error": OddProgram("print(1)\nx = = 2"),
    "group of exceptions": OddProgram("raise ExceptionGroup('two', [ValueError(1), KeyError(2)])"),
    "endless recursion": OddProgram("def f():\n    f()\nf()"),
    "recursion limit": OddProgram(
        "import sys\ndef depth(n):\n    try:\n        return depth(n + 1)\n"
        "    except RecursionError:\n        return n\nprint(sys.getrecursionlimit(), depth(0))"
    ),
    "abort": OddProgram(_STEPS + "import os, sys; sys.stdout.flush(); os.abort()"),
    "crash": OddProgram("import ctypes\nprint('now', flush=True)\nctypes.string_at(0)"),
    "exception hook": OddProgram(
        "import sys\nsys.excepthook = lambda *error: print('hook', error[0].__name__)\n1 / 0"
    ),
    "exit handlers": OddProgram(
        _STEPS + "import atexit\nfor i in range(3):\n    atexit.register(print, 'exit', i)"
    ),
    "objects that outlive the program": OddProgram(
        _STEPS + "import weakref\n"
        "class Late:\n    def __del__(self):\n        print('deleted')\n"
        "late = Late()\nweakref.finalize(late, print, 'finalized')\n"
        "def rows():\n    try:\n        yield 1\n    finally:\n        print('closed')\n"
        "open_rows = rows()\nnext(open_rows)"
    ),
    "exception while an object is deleted": OddProgram(
        "class Bad:\n    def __del__(self):\n        raise ValueError('late')\nbad = Bad()\ndel bad"
    ),
    "unraisable hook": OddProgram(
        "import sys\nsys.unraisablehook = lambda u: print('hook', u.exc_value)\n"
        "class Bad:\n    def __del__(self):\n        raise ValueError('late')\nbad = Bad()\ndel bad"
    ),
    # Signals
    "Ctrl-C": OddProgram(
        _STEPS + "import time\nprint('ready', flush=True); time.sleep(30)",
        signal_number=signal.SIGINT,
    ),
    "Ctrl-C that is caught": OddProgram(
        _STEPS + "import time\ntry:\n    print('ready', flush=True)\n    time.sleep(30)\n"
        "except KeyboardInterrupt:\n    print('caught')",
        signal_number=signal.SIGINT,
    ),
    "SIGTERM": OddProgram(
        _STEPS + "import time\nprint('ready', flush=True); time.sleep(30)",
        signal_number=signal.SIGTERM,
    ),
    "SIGTERM that is handled": OddProgram(
        "import signal, sys, time\nsignal.signal(signal.SIGTERM, lambda *_: sys.exit(9))\n"
        + _STEPS
        + "print('ready', flush=True); time.sleep(30)",
        signal_number=signal.SIGTERM,
    ),
    "SIGUSR1": OddProgram(
        # not `signal.pause`, which waits forever where the signal comes just before it
        "import signal, time\nseen = []\n"
        "signal.signal(signal.SIGUSR1, lambda *_: seen.append(print('usr1')))\n"
        "print('ready', flush=True)\nwhile not seen:\n    time.sleep(0.01)",
        signal_number=signal.SIGUSR1,
    ),
    "alarm": OddProgram(
        _STEPS + "import signal, time\n"
        "def late(number, frame):\n    raise TimeoutError(signal.Signals(number).name)\n"
        "signal.signal(signal.SIGALRM, late)\nsignal.setitimer(signal.ITIMER_REAL, .05)\n"
        "while True:\n    mujoco.mj_step(model, data)"
    ),
    "signal handlers": OddProgram(
        "import signal\nprint([(s.name, str(signal.getsignal(s))[:30]) for s in"
        " (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGPIPE, signal.SIGUSR1)])\n"
        "print(signal.pthread_sigmask(signal.SIG_BLOCK, []))"
    ),
    # How it was started
    "arguments": OddProgram("import sys\nprint(sys.argv, sys.orig_argv[1:])"),
    "interpreter": OddProgram(
        "import sys\nprint(sys.executable, sys.flags, sys.warnoptions, sys._xoptions, sys.prefix)"
    ),
    "module path": OddProgram("import os, sys\nprint(sys.path[0], len(sys.path), os.getcwd())"),
    "standard input": OddProgram(
        _STEPS + "import sys\nprint(input(), sys.stdin.read().upper(), sys.stdin.isatty())",
        stdin="first\nsecond\nthird",
    ),
    "main module": OddProgram(
        "import sys\nmain = sys.modules['__main__']\n"
        "print(sorted(vars(main)), __name__, __file__, __spec__, __package__, __doc__)"
    ),
    "module": OddProgram("", arguments=("-m", "package", "x"), files=_PACKAGE),
    "module in a package": OddProgram("", arguments=("-m", "package.part"), files=_PACKAGE),
    "missing module": OddProgram("", arguments=("-m", "no_such_module")),
    "folder": OddProgram(
        "", arguments=("folder",), files={"folder/__main__.py": "print(__file__)"}
    ),
    "runpy": OddProgram(
        "import runpy\nrunpy.run_module('package', run_name='__main__')\n"
        "print(sorted(runpy.run_path('other.py'))[-1])",
        files={**_PACKAGE, "other.py": "zero = __name__\nprint(zero)"},
    ),
    "relative paths": OddProgram(
        "import os, pathlib\npathlib.Path('a.txt').write_text('a')\nos.mkdir('b')\nos.chdir('b')\n"
        + _STEPS
        + "open('c.txt', 'w').write(os.path.basename(os.getcwd()))"
    ),
    "folder that is gone": OddProgram(
        "import os\nos.mkdir('gone')\nos.chdir('gone')\nos.rmdir('../gone')\n" + _STEPS
    ),
    "options of warnings": OddProgram(
        _STEPS + "import warnings\nwarnings.warn('old', DeprecationWarning)\n"
        "warnings.warn('late')\nopen('program.py')",
        environment={"PYTHONWARNINGS": "default"},
    ),
    "warnings as errors": OddProgram(
        _STEPS + "import warnings\nwarnings.warn('late')", environment={"PYTHONWARNINGS": "error"}
    ),
    "development mode": OddProgram(
        _STEPS + "import faulthandler\nprint(faulthandler.is_enabled())",
        environment={"PYTHONDEVMODE": "1"},
    ),
    # Text
    "output without an end of line": OddProgram(
        "import sys\nprint('a', end='')\nsys.stderr.write('b')\nprint('c', end='')"
    ),
    "output that nobody reads": OddProgram(
        "for i in range(100_000):\n    print('x' * 50)", closes_output=True
    ),
    "closed output": OddProgram(_STEPS + "import sys\nsys.stdout.close()\nsys.stderr.close()"),
    "byte order mark": OddProgram(b"\xef\xbb\xbfprint('\xc3\xa4')"),
    "encoding": OddProgram(b"# -*- coding: latin-1 -*-\nprint(ascii('\xe4'))"),
    "no end of line": OddProgram("print(1)\nif True:\n    print(2)"),
    "encoding of streams": OddProgram(
        "import sys, locale, decimal\n"
        "print(sys.stdout.encoding, sys.stdout.errors, sys.stdout.line_buffering,"
        " sys.stderr.errors, locale.getlocale(), locale.getpreferredencoding(),"
        " decimal.getcontext(), '\\u00e4')"
    ),
    "reads its own source": OddProgram(
        "import inspect\ndef f():\n    return 1  # one\n"
        "print(inspect.getsource(f), open(__file__).read()[:6], inspect.getfile(f))"
    ),
    "logging": OddProgram(
        _STEPS + "import logging\nlogging.warning('w')\nlogging.getLogger().handlers[0].flush()"
    ),
    # Processes and threads
    "fork": OddProgram(_WORKERS.replace("{method}", "fork")),
    "spawn": OddProgram(
        "import os\nos.write(1, f'{__name__}\\n'.encode())\n"
        + _WORKERS.replace("{method}", "spawn")
    ),
    "forkserver": OddProgram(_WORKERS.replace("{method}", "forkserver")),
    "os.fork": OddProgram(
        _STEPS + "import os, sys\nsys.stdout.flush()\npid = os.fork()\n"
        "for _ in range(300):\n    mujoco.mj_step(model, data)\n"
        "if not pid:\n    sys.exit(4)\n"
        "print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), round(data.time, 3))"
    ),
    "os.execv": OddProgram(
        _STEPS + "import os, sys\nsys.stdout.flush()\n"
        "if len(sys.argv) < 4:\n"
        "    os.execv(sys.executable, [sys.executable, *sys.argv, 'again'])\n"
        "print(sys.argv)\nsys.exit(6)"
    ),
    "child of the same interpreter": OddProgram(
        _STEPS + "import subprocess, sys\n"
        "done = subprocess.run([sys.executable, '-c', 'import sys; print(sys.argv); sys.exit(8)'],"
        " capture_output=True, text=True)\nprint(done)"
    ),
    "isolated child": OddProgram(
        "import subprocess, sys\nprint(subprocess.run([sys.executable, '-I', '-c',"
        " 'import mujoco, sys; print(len(sys.path), sys.flags.isolated)'],"
        " capture_output=True, text=True).stdout)"
    ),
    "pool of processes that fails": OddProgram(
        "from concurrent.futures import ProcessPoolExecutor\ndef f(x):\n    return 1 // x\n"
        "if __name__ == '__main__':\n    with ProcessPoolExecutor(1) as pool:\n"
        "        print(list(pool.map(f, [1])))\n"
        "        try:\n            pool.submit(f, 0).result()\n"
        "        except ZeroDivisionError as error:\n            print(repr(error))"
    ),
    "threads": OddProgram(
        _STEPS + "import threading\nfrom concurrent.futures import ThreadPoolExecutor\n"
        "def steps(count):\n    own = mujoco.MjData(model)\n    for _ in range(count):\n"
        "        mujoco.mj_step(model, own)\n    return round(own.time, 3)\n"
        "with ThreadPoolExecutor(3) as pool:\n    print(list(pool.map(steps, [5, 300, 900])))\n"
        "print(threading.active_count(), threading.main_thread().name)"
    ),
    "daemon thread": OddProgram(
        _STEPS + "import threading, time\n"
        "threading.Thread(target=time.sleep, args=(60,), daemon=True).start()\nprint('end')"
    ),
    "exception in a thread": OddProgram(
        _STEPS + "import threading\ndef f():\n    raise ValueError('in a thread')\n"
        "thread = threading.Thread(target=f, name='worker')\nthread.start()\nthread.join()"
    ),
    "asyncio": OddProgram(
        _STEPS + "import asyncio\nasync def steps():\n    for _ in range(3):\n"
        "        mujoco.mj_step(model, data)\n        await asyncio.sleep(0)\n    return 3\n"
        "async def main():\n    print(await asyncio.gather(steps(), steps()))\nasyncio.run(main())"
    ),
    "closes all files": OddProgram(
        "import os\nimport mujoco\nos.closerange(3, 1000)\n"
        "with open('first.txt', 'w') as first, open('second.txt', 'w') as second:\n"
        "    first.write('first')\n    second.write('second')\n"
        + "\n".join(f"    {line}" for line in _STEPS.splitlines())
        + "\n    mujoco.mj_forward(model, data)\n    mujoco.mj_resetData(model, data)\n"
    ),
    "limit of open files": OddProgram(
        "import resource\nresource.setrlimit(resource.RLIMIT_NOFILE, (64, 64))\n" + _STEPS
    ),
    # Tools that look into a program
    "tracer": OddProgram(
        _STEPS + "import sys\nlines = []\ndef trace(frame, event, argument):\n"
        "    if frame.f_code.co_filename == __file__:\n"
        "        lines.append((event, frame.f_lineno))\n        return trace\n"
        "def f():\n    mujoco.mj_step(model, data)\n    return 1\n"
        "sys.settrace(trace)\nf()\nsys.settrace(None)\nprint(lines)"
    ),
    "profile": OddProgram(
        _STEPS + "import cProfile, pstats\ndef f():\n    mujoco.mj_step(model, data)\n"
        "profile = cProfile.Profile()\nprofile.runcall(f)\n"
        "print([v[:2] for k, v in pstats.Stats(profile).stats.items() if k[0] == __file__])"
    ),
    "fault handler": OddProgram(
        "import faulthandler\nprint(faulthandler.is_enabled(), flush=True)\n"
        "faulthandler.dump_traceback()"
    ),
    "fault handler that is enabled": OddProgram(
        "import ctypes, faulthandler\nfaulthandler.enable()\nctypes.string_at(0)"
    ),
    "memory tracer": OddProgram(
        "import tracemalloc\ntracemalloc.start()\nx = bytearray(1000)\n"
        "own = tracemalloc.take_snapshot().filter_traces([tracemalloc.Filter(True, __file__)])\n"
        "print([s.count for s in own.statistics('lineno')])"
    ),
    "garbage collector": OddProgram(
        _STEPS + "import gc\nprint(gc.isenabled(), gc.get_threshold(), gc.get_debug(), gc.garbage)"
    ),
    "unit tests": OddProgram(
        "import unittest, mujoco\nclass Test(unittest.TestCase):\n    def test_it(self):\n"
        "        self.assertEqual(1, 2)\nimport io\n"
        "runner = unittest.TextTestRunner(io.StringIO())\n"
        "print(unittest.main(argv=['x'], testRunner=runner, exit=False).result.failures[0][1])"
    ),
    "doctest": OddProgram(
        "def f():\n    '''\n    >>> f()\n    1\n    '''\n    return 2\n"
        "import doctest\nprint(doctest.testmod())"
    ),
    # MuJoCo's objects
    "all names of MuJoCo": OddProgram("from mujoco import *\n" + _STEPS + "mj_step(model, data)"),
    "names of functions": OddProgram(
        _STEPS + "for f in (mujoco.mj_step, mujoco.mj_forward, mujoco.mj_resetData,"
        " mujoco.MjModel.from_xml_string, mujoco.MjData.__init__, mujoco.Renderer.render):\n"
        "    print(f.__name__, f.__qualname__, f.__module__, len(f.__doc__ or ''), callable(f))"
    ),
    "signature": OddProgram(
        _STEPS + "import inspect\n"
        "for f in (mujoco.mj_step, mujoco.mj_forward, mujoco.mj_resetData,"
        " mujoco.Renderer.render, mujoco.Renderer):\n"
        "    try:\n        print(inspect.signature(f))\n"
        "    except ValueError as error:\n        print('none', str(error)[:20])"
    ),
    "kinds of functions": OddProgram(
        "import inspect, mujoco\n"
        "print(inspect.isroutine(mujoco.mj_step), inspect.isclass(mujoco.MjData))\n"
        "print(len(inspect.getmembers(mujoco, inspect.isroutine)), len(dir(mujoco)))"
    ),
    "identity of functions": OddProgram(
        "import mujoco\nfrom mujoco import mj_step, mj_forward\n"
        "print(mujoco.mj_step is mj_step, mujoco.mj_forward == mj_forward,"
        " {mj_step: 1}[mujoco.mj_step])"
    ),
    "function of its own in place of mj_step": OddProgram(
        _STEPS + "original, count = mujoco.mj_step, [0]\n"
        "def counted(*arguments, **more):\n    count[0] += 1\n"
        "    return original(*arguments, **more)\n"
        "mujoco.mj_step = counted\nfor _ in range(500):\n    mujoco.mj_step(model, data)\n"
        "print(count, mujoco.mj_step is counted)\nmujoco.mj_step = original\n"
        "mujoco.mj_step(model, data)\nprint(count, round(data.time, 3))"
    ),
    "mock": OddProgram(
        _STEPS + "from unittest import mock\n"
        "with mock.patch('mujoco.mj_step') as step:\n    mujoco.mj_step(model, data)\n"
        "    print(step.call_count)\nmujoco.mj_step(model, data)\nprint(round(data.time, 3))"
    ),
    "partial": OddProgram(
        _STEPS + "import functools\nstep = functools.partial(mujoco.mj_step, model, data)\n"
        "step()\nstep(nstep=3)\nstep(2)\nprint(round(data.time, 3))"
    ),
    "function as an attribute": OddProgram(
        _STEPS + "class Env:\n    step = mujoco.mj_step\n    forward = mujoco.mj_forward\n"
        "Env().step(model, data)\nEnv.step(model, data)\nEnv().forward(model, data)\n"
        "print(round(data.time, 3))"
    ),
    "keywords": OddProgram(
        _STEPS + "mujoco.mj_step(m=model, d=data)\nmujoco.mj_step(model, d=data, nstep=2)\n"
        "mujoco.mj_forward(m=model, d=data)\nmujoco.mj_resetData(m=model, d=data)\nprint(data.time)"
    ),
    "pickled functions": OddProgram(
        _STEPS + "import copy, pickle\nprint(pickle.loads(pickle.dumps(mujoco.mj_step)) is"
        " mujoco.mj_step, copy.copy(mujoco.mj_forward) is mujoco.mj_forward)"
    ),
    "pickled objects": OddProgram(
        _STEPS + "import copy, pickle\nfor each in (pickle.loads(pickle.dumps(data)),"
        " copy.copy(data), copy.deepcopy(data)):\n    print(type(each), each.time, each.qpos)\n"
        "print(pickle.loads(pickle.dumps(model)).nq, copy.deepcopy(model).nv)"
    ),
    "pickled class of the program": OddProgram(
        _STEPS + "import dataclasses, pickle\n@dataclasses.dataclass\nclass Row:\n    time: float\n"
        "raw = pickle.dumps(Row(data.time))\nprint(raw, pickle.loads(raw))"
    ),
    "class of its own": OddProgram(
        _STEPS + "class Mine(mujoco.MjData):\n    def __init__(self, model):\n"
        "        super().__init__(model)\n        self.extra = 1\n"
        "mine = Mine(model)\nmujoco.mj_step(model, mine)\n"
        "print(mine.extra, mine.time, isinstance(mine, mujoco.MjData), Mine.__mro__)"
    ),
    "callback": OddProgram(
        _STEPS + "calls = []\ndef control(model, data):\n    calls.append(data.time)\n"
        "mujoco.set_mjcb_control(control)\nmujoco.mj_step(model, data)\n"
        "print(len(calls), mujoco.get_mjcb_control() is control)\nmujoco.set_mjcb_control(None)\n"
        "print(mujoco.get_mjcb_control())"
    ),
    "exception in a callback": OddProgram(
        _STEPS + "def control(model, data):\n    raise ValueError('in a callback')\n"
        "mujoco.set_mjcb_control(control)\nmujoco.mj_step(model, data)"
    ),
    "reloaded": OddProgram(
        _STEPS + "import importlib\nimportlib.reload(mujoco)\nmujoco.mj_step(model, data)\n"
        "print(round(data.time, 3))"
    ),
    "random numbers": OddProgram(
        _STEPS + "import random\nimport numpy as np\nrandom.seed(1)\nnp.random.seed(1)\n"
        "print(random.random(), np.random.rand(), np.random.default_rng(2).random())"
    ),
    "bits of a simulation": OddProgram(
        _STEPS + "print(data.qpos.tobytes(), data.qacc_warmstart.tobytes(), data.time)"
    ),
    "rollout": OddProgram(
        _STEPS + "import numpy as np\nfrom mujoco import rollout\n"
        "size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)\n"
        "states, sensors = rollout.rollout(model, data, np.zeros((3, size)), nstep=5)\n"
        "print(states.shape, states.sum(), rollout.rollout.__name__)"
    ),
}
