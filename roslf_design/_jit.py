"""One source, two speeds: scalar kernels that run as plain Python for a few values and through numba for many.

Importing numba and loading its first compiled function costs about 0.6 s, more than a whole `roslf evaluate` may
take; interpreting a kernel costs tens of microseconds a call. So a kernel is written once, as ordinary Python over
floats and arrays, runs interpreted as it stands, and is compiled only when somebody asks for `compiled`.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from functools import cache, cached_property, partial
from pathlib import Path
from types import CodeType, FunctionType
from typing import TYPE_CHECKING, Any, Generic, ParamSpec, TypeVar, cast

import numpy as np

if TYPE_CHECKING:
    from concurrent.futures import ThreadPoolExecutor

P = ParamSpec("P")
R = TypeVar("R")

CALL, LOAD, IMPORT, COMPILE = 4e-5, 0.15, 0.4, 6.0
"""Seconds of interpreting from which machine code pays: of one call where it is in memory; else of all calls so far,
where it lies on disk and numba is imported already or not, and where it is yet to be compiled."""
_interpreted = [0.0]
_unshelved = [0.0]
_making = [0]
PATIENCE = ContextVar("PATIENCE", default=COMPILE)
"""`COMPILE`, or less within `compiling`."""
_AHEAD = ContextVar("_AHEAD", default=0.0)
"""Seconds of interpreting that are known to come, within `ahead`."""

PLAIN = (bool, int, float, str, tuple)
"""Kinds of module constants that are compiled into a kernel."""

COMPILED = False
"""Whether a kernel that reads it is compiled: true in its compiled twin."""

WIDE = '"prefer-vector-width"="512"'
"""Attribute of a function that is compiled for vectors of 512 bits."""

Band = tuple[int, int]
"""Which of how many bands of a loop a thread works on."""
WHOLE: Band = (0, 1)


def soon_written(array: Any, index: int) -> None:
    """In a kernel that is compiled: fetch the line of the cache to write to, while other things are computed."""


_COMPILING = threading.RLock()


class Kernel(Generic[P, R]):
    """A plain Python function that can also be had compiled.

    Kernels may call kernels, of any file; the callees are swapped for their compiled twins when the caller is compiled.
    Divisions by zero must be guarded in the source (interpreted, they raise).
    """

    def __init__(
        self, function: Callable[P, R], parallel: bool = False, inline: bool = False, apart: bool = False
    ) -> None:
        self.interpreted = function
        self.parallel = parallel
        self.inline = inline
        self.apart = apart
        self.__doc__ = function.__doc__
        self.__name__ = getattr(function, "__name__", "kernel")
        self._compiled: Callable[P, R] | None = None

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        return self.interpreted(*args, **kwargs)

    @cached_property
    def digest(self) -> str:
        """Fingerprint of this kernel with all that it calls and all constants it reads."""
        import hashlib  # with OpenSSL, for kernels that are compiled only

        source = self.interpreted
        assert isinstance(source, FunctionType)
        fingerprint = hashlib.sha256(source.__code__.co_code + WIDE.encode() + (b"inline" if self.inline else b""))
        fingerprint.update(b"apart" if self.apart else b"")
        for constant in source.__code__.co_consts:
            fingerprint.update(constant.co_code if isinstance(constant, CodeType) else repr(constant).encode())
        for name in source.__code__.co_names:
            value = source.__globals__.get(name)
            known = value.digest if isinstance(value, Kernel) else repr(value) if isinstance(value, PLAIN) else ""
            fingerprint.update(f"{name}={known};".encode())
        return fingerprint.hexdigest()[:16]

    @property
    def ready(self) -> bool:
        """Whether the compiled twin is in memory: from then on interpreting saves nothing."""
        return self._compiled is not None

    @cached_property
    def shelved(self) -> bool:
        """Whether machine code of it lies on disk, so that it is loaded, not compiled."""
        twin = self._twin()
        source = Path(twin.__code__.co_filename)
        beside = source.parent / "__pycache__"
        # Numba is not asked where that is plain: importing it takes longer than most of what is asked for.
        plain = "NUMBA_CACHE_DIR" not in os.environ and os.access(beside, os.W_OK)
        folder = beside if plain else _cache_folder(twin)
        shelf = [] if folder is None else [index.stat() for index in folder.glob(f"*{twin.__qualname__}-*.nbi")]
        return any(index.st_mtime >= source.stat().st_mtime for index in shelf)

    def pays(self, seconds: float) -> bool:
        """Whether machine code is done first with what takes so many seconds interpreted, all told."""
        if self.ready:
            return seconds >= CALL
        _interpreted[0] += seconds
        patience = PATIENCE.get()
        if patience and self.shelved:
            patience = (LOAD if "numba" in sys.modules else IMPORT) - _AHEAD.get()
        elif _interpreted[0] < patience:
            _unshelved[0] += seconds
        return _interpreted[0] >= patience

    def quickest(self, seconds: float) -> Callable[P, R]:
        """The twin that is done first with what takes so many seconds interpreted.

        Of kernels that fill what they are given, and add nothing to it: what Python will not divide or take a root of
        is done once more by machine code.
        """
        return self.compiled if self.pays(seconds) else self._without_complaint

    def _without_complaint(self, *args: P.args, **kwargs: P.kwargs) -> R:
        try:
            with np.errstate(all="ignore"):
                return self.interpreted(*args, **kwargs)
        except (ArithmeticError, ValueError):
            return self.compiled(*args, **kwargs)

    def _twin(self) -> FunctionType:
        """The function as it is compiled, in names of its own.

        Numba's disk cache knows a function by its name and its own file's date, so a change in a callee's file would go
        unnoticed and old machine code would run; with the digest in the name it cannot.
        """
        source = self.interpreted
        assert isinstance(source, FunctionType)
        names = dict(source.__globals__)
        twin = FunctionType(source.__code__, names, source.__name__, source.__defaults__, source.__closure__)
        twin.__qualname__, twin.__module__ = f"{source.__qualname__}_{self.digest}", source.__module__
        return twin

    @property
    def on_one_thread(self) -> Callable[P, R]:
        """The numba twin, compiled (or read from numba's disk cache) on first use."""
        if self._compiled is None:
            with _COMPILING:
                if self._compiled is None:
                    self._compiled = _compile(self)
        return self._compiled

    @cached_property
    def compiled(self) -> Callable[P, R]:
        """The numba twin; where the kernel is `parallel`, its loop is shared among all threads."""
        return _shared(self.on_one_thread) if self.parallel else self.on_one_thread


def cold_seconds() -> float:
    """Seconds that this process has spent, about, as machine code was not yet on disk: compiling, or doing without."""
    return _unshelved[0]


def is_compiling() -> bool:
    """Whether machine code is being made at the moment that is not on disk."""
    return _making[0] > 0


@cache
def _numba() -> Any:
    """Numba, without the BLAS that it looks for: scipy.linalg, more than half of what the first kernel waits for.

    A kernel with matrix products finds it all the same, when it is compiled.
    """
    import numba
    from numba.np import linalg

    search, linalg.ensure_blas = linalg.ensure_blas, lambda: None
    try:
        importlib.import_module("numba.np.arraymath")
    finally:
        linalg.ensure_blas = search
    return numba


@contextlib.contextmanager
def _uncollected() -> Iterator[None]:
    """Within it no garbage is looked for: a compilation makes little, and would be looked through again and again."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


@contextlib.contextmanager
def _wide_vectors() -> Iterator[None]:
    """Within it, code is compiled for vectors as wide as the processor's, and no other thread compiles.

    On processors alone whose clock they do not slow (Ice Lake and later): the same bits, a quarter more rays through
    spheres. Numba's settings would do it for all code of the process; llvmlite's attributes are a set that takes words
    without a value only.
    """
    from numba.core import codegen, compiler_lock, registry

    context, features_of = cast(Any, registry.cpu_target.target_context), cast(Any, codegen.get_host_cpu_features)
    declare, wide = context.declare_function, "+avx512vbmi2" in features_of()

    def declare_wide(*arguments: Any) -> Any:
        function = declare(*arguments)
        set.add(function.attributes, WIDE)
        return function

    with cast(Any, compiler_lock.global_compiler_lock), contextlib.ExitStack() as stack:
        if wide:
            context.declare_function = declare_wide
            stack.callback(setattr, context, "declare_function", declare)
        yield


def _compile(kernel: Kernel[P, R]) -> Callable[P, R]:
    numba, twin = _numba(), kernel._twin()
    names = twin.__globals__

    def swap_callees() -> None:
        for name in twin.__code__.co_names:
            value = names.get(name)
            if isinstance(value, Kernel):
                names[name] = value.on_one_thread
            elif value is soon_written:
                names[name] = _fetch_to_write()
            elif name == "COMPILED":
                names[name] = True

    folder = _cache_folder(twin)
    alone = contextlib.nullcontext if folder is None else partial(_alone, folder / f"{twin.__qualname__}.lock")
    compiled: Any = numba.njit(
        cache=folder is not None, fastmath=False, error_model="numpy", nogil=True,
        inline="always" if kernel.inline else "never",
    )(twin)  # fmt: skip
    if kernel.apart:
        compiled._compiler._customize_flags = _without_alias
    compile_now, unliteral, shelf = compiled.compile, numba.types.unliteral, compiled._cache

    def load_alone(signature: Any, context: Any) -> Any:  # numba's own first loads all that a compilation may need
        numba.core.runtime.rtsys.initialize(context)
        with shelf._guard_against_spurious_io_errors():
            return shelf._load_overload(signature, context)

    if folder is not None:
        shelf.load_overload = load_alone
    compile_afresh = compiled._compiler.compile

    def compile_with_callees(*arguments: Any) -> Any:  # machine code that is read from disk has its callees in it
        swap_callees()
        return compile_afresh(*arguments)

    compiled._compiler.compile = compile_with_callees
    if kernel.inline:  # its lines are read where they are put, without a compilation of its own
        swap_callees()

    def compile_once(types: tuple[Any, ...]) -> Any:
        # In one process, then among all: who waited reads what the other compiled. Numba would compile once more for
        # literal arguments, and for arrays that are read only, without any gain.
        plain = tuple(_writable(unliteral(kind)) for kind in types)
        with _COMPILING, alone(), _wide_vectors(), _uncollected():
            shelved, began, before = kernel.shelved, time.perf_counter(), _unshelved[0]
            _making[0] += not shelved
            try:
                code = compile_now(plain)
            except OSError:  # the folder is full: compiled, not kept
                code = compile_now(plain)
            finally:
                _making[0] -= not shelved
            if not shelved:
                _unshelved[0] = before + time.perf_counter() - began  # its callees' time is in it
            if plain != tuple(types):
                compiled._insert([kind._code for kind in types], code)
        return code

    compiled.compile = compile_once
    fast: Callable[P, R] = compiled
    return fast


def threads() -> int:
    """How many threads the loops of parallel kernels are shared among: NUMBA_NUM_THREADS, or as many as processors."""
    return int(_numba().config.NUMBA_NUM_THREADS)


@cache
def _others() -> ThreadPoolExecutor:
    """Threads beside the one that calls."""
    from concurrent.futures import ThreadPoolExecutor  # for kernels that are compiled only

    return ThreadPoolExecutor(threads())


def _shared(machine: Any) -> Callable[..., Any]:
    """A parallel kernel's machine code, which has its loop's band last, on all threads.

    Numba's own would take three times as long to compile, and abort where two threads call at once.
    """

    def run(*args: Any) -> Any:
        if not machine.overloads:  # compiled here, where Ctrl-C ends it
            machine.compile(tuple(map(machine.typeof_pyval, (*args, WHOLE))))
        count = threads()
        bands = [_others().submit(partial(machine, *args, (band, count))) for band in range(1, count)]
        result = machine(*args, (0, count))
        for band in bands:
            band.result()
        return result

    return run


@cache
def _fetch_to_write() -> Any:
    """`soon_written` in the words of LLVM; neither Python nor numba has one for it."""
    ir, cgutils, types, extending = map(
        importlib.import_module, ("llvmlite.ir", "numba.core.cgutils", "numba.core.types", "numba.extending")
    )

    def write(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array, word = context.make_array(signature.args[0])(context, builder, arguments[0]), ir.IntType(32)
        place = builder.bitcast(builder.gep(array.data, [arguments[1]]), cgutils.voidptr_t)
        kind = ir.FunctionType(ir.VoidType(), [place.type, word, word, word])
        fetch = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0i8")
        builder.call(fetch, [place, word(1), word(3), word(1)])  # to write; to the nearest cache; data
        return context.get_dummy_value()

    return extending.intrinsic(lambda typing, array, index: (types.void(array, index), write))


def _without_alias(flags: Any) -> Any:
    """Numba's settings of a function, of arguments that do not overlap."""
    flags.noalias = True
    return flags


def _writable(kind: Any) -> Any:
    """Type of an argument as it is compiled for: arrays as if they could be written to."""
    types: Any = _numba().types
    if isinstance(kind, types.BaseTuple):
        return types.BaseTuple.from_types(tuple(map(_writable, kind)), getattr(kind, "instance_class", None))
    return kind.copy(readonly=False) if isinstance(kind, types.Array) else kind


def _cache_folder(function: FunctionType) -> Path | None:
    """Where numba keeps a function's machine code; None where it may write nowhere."""
    from numba.core import caching

    cache: Any = caching.FunctionCache
    try:
        return Path(cache(function).cache_path)
    except (RuntimeError, OSError):  # none of its places is there
        return None


@contextlib.contextmanager
def _alone(path: Path) -> Iterator[None]:
    """Wait until no other process holds the file; processes that end let go of it."""
    try:
        import fcntl
    except ImportError:  # no such locks on Windows: two processes may compile the same
        yield
        return
    with contextlib.ExitStack() as held:
        with contextlib.suppress(OSError):  # file systems without locks, full, or not to be written to
            fcntl.flock(held.enter_context(path.open("w")), fcntl.LOCK_EX)
        yield


def kernel(
    *, parallel: bool = False, inline: bool = False, apart: bool = False
) -> Callable[[Callable[P, R]], Kernel[P, R]]:
    """Make a function a `Kernel`.

    With `parallel`, its last argument is a `Band`, and its `prange` is shared among threads when compiled. One that is
    `inline` becomes part of compiled callers, for loops that are made vectors of only so. What `apart` is given never
    overlaps, so that loops over many arrays are made vectors of, too.
    """

    def wrap(function: Callable[P, R]) -> Kernel[P, R]:
        return Kernel(function, parallel, inline, apart)

    return wrap


@kernel()
def prange(count: int, band: Band) -> range:
    """A band's part of the turns of a loop that do not hang on each other."""
    return range(count * band[0] // band[1], count * (band[0] + 1) // band[1])


@contextlib.contextmanager
def compiling() -> Iterator[None]:
    """Within it, machine code is made of all that runs, however little that is."""
    before = PATIENCE.set(0.0)
    try:
        yield
    finally:
        PATIENCE.reset(before)


@contextlib.contextmanager
def ahead(seconds: float) -> Iterator[None]:
    """Within it, so much interpreting is known to come: machine code on disk is loaded at once where that pays."""
    before = _AHEAD.set(seconds)
    try:
        yield
    finally:
        _AHEAD.reset(before)
