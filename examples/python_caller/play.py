"""A trained policy in a Python program, through ctypes: no package is needed, only libcale_policy_c.so.

The "game" is the one of examples/c_caller: a square that the joystick moves over a gray screen.
"""
import ctypes
import sys

ROWS, COLUMNS, SQUARE, FRAMES = 210, 160, 16, 120
GREEDY = 0


class Decision(ctypes.Structure):
    _fields_ = [
        ("radius", ctypes.c_float),
        ("theta", ctypes.c_float),
        ("fire", ctypes.c_float),
        ("action", ctypes.c_int32),
        ("event", ctypes.c_int32),
        ("strength", ctypes.c_float),
    ]


def open_library(path):
    """The functions of cale_policy.h that are used here, with their types."""
    library = ctypes.CDLL(path)
    pointer, size = ctypes.c_void_p, ctypes.c_size_t
    signatures = {
        "cale_policy_load": (pointer, [ctypes.c_char_p]),
        "cale_policy_free": (None, [pointer]),
        "cale_policy_error": (ctypes.c_char_p, []),
        "cale_session_new": (pointer, [pointer, ctypes.c_int32, ctypes.c_uint64]),
        "cale_session_free": (None, [pointer]),
        "cale_session_start": (ctypes.c_int, [pointer, ctypes.c_char_p, size]),
        "cale_session_see": (ctypes.c_int, [pointer, ctypes.c_char_p, size]),
        "cale_session_due": (ctypes.c_int, [pointer]),
        "cale_session_act": (ctypes.c_int, [pointer, ctypes.c_int, ctypes.POINTER(Decision)]),
    }
    for name, (result, arguments) in signatures.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library


def screen_with_square(x, y):
    screen = bytearray(ROWS * COLUMNS)
    for row in range(y, y + SQUARE):
        screen[row * COLUMNS + x : row * COLUMNS + x + SQUARE] = b"\xff" * SQUARE
    return bytes(screen)


def main(library_path, policy_path):
    cale = open_library(library_path)

    def checked(result):
        if not result:
            sys.exit("play.py: " + cale.cale_policy_error().decode())
        return result

    policy = checked(cale.cale_policy_load(policy_path.encode()))
    session = checked(cale.cale_session_new(policy, ROWS, 1))
    cale.cale_policy_free(policy)  # the session goes on

    x, y = 72, 97
    screen = screen_with_square(x, y)
    checked(cale.cale_session_start(session, screen, len(screen)))
    decision = Decision()
    for frame in range(FRAMES):
        if cale.cale_session_due(session):
            checked(cale.cale_session_act(session, GREEDY, ctypes.byref(decision)))
            print(frame, decision.event)
        # ALE's events: 2 up, 3 right, 4 left, 5 down; the rest stands still here
        x = min(max(x + {3: 1, 4: -1}.get(decision.event, 0), 0), COLUMNS - SQUARE)
        y = min(max(y + {5: 1, 2: -1}.get(decision.event, 0), 0), ROWS - SQUARE)
        screen = screen_with_square(x, y)
        checked(cale.cale_session_see(session, screen, len(screen)))
    cale.cale_session_free(session)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("usage: play.py LIBCALE_POLICY_C.so POLICY.safetensors")
    main(sys.argv[1], sys.argv[2])
