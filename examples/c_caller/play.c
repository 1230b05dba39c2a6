/* A trained policy in a program in C. The "game" is a square that the joystick moves over a gray screen. */
#include <policy/cale_policy.h>

#include <stdio.h>
#include <string.h>

enum { ROWS = 210, COLUMNS = 160, SQUARE = 16, FRAMES = 120 };

static uint8_t screen[ROWS * COLUMNS];

static void draw(int x, int y) {
    memset(screen, 0, sizeof screen);
    for (int row = y; row < y + SQUARE; ++row) memset(screen + row * COLUMNS + x, 255, SQUARE);
}

static int fail(void) {
    fprintf(stderr, "c_caller: %s\n", cale_policy_error());
    return 1;
}

int main(int argc, char** argv) {
    const int asked = argc == 2 && strcmp(argv[1], "--help") == 0;
    if (argc != 2 || asked) {
        fprintf(asked ? stdout : stderr, "usage: c_caller POLICY.safetensors\n");
        return asked ? 0 : 2;
    }
    cale_policy* policy = cale_policy_load(argv[1]);
    if (policy == NULL) return fail();
    cale_session* session = cale_session_new(policy, ROWS, /*seed=*/1);
    if (session == NULL) return fail();
    cale_policy_free(policy); /* the session goes on */

    int x = 72, y = 97;
    draw(x, y);
    if (!cale_session_start(session, screen, sizeof screen)) return fail();
    cale_decision decision = {0};
    for (int frame = 0; frame < FRAMES; ++frame) {
        if (cale_session_due(session)) {
            if (!cale_session_act(session, CALE_GREEDY, &decision)) return fail();
            printf("%d %d\n", frame, decision.event);
        }
        /* ALE's events: 2 up, 3 right, 4 left, 5 down; the rest stands still here */
        x += decision.event == 3 ? 1 : decision.event == 4 ? -1 : 0;
        y += decision.event == 5 ? 1 : decision.event == 2 ? -1 : 0;
        x = x < 0 ? 0 : x > COLUMNS - SQUARE ? COLUMNS - SQUARE : x;
        y = y < 0 ? 0 : y > ROWS - SQUARE ? ROWS - SQUARE : y;
        draw(x, y);
        if (!cale_session_see(session, screen, sizeof screen)) return fail();
    }
    cale_session_free(session);
    if (fflush(stdout) != 0 || ferror(stdout)) {
        perror("c_caller");
        return 1;
    }
    return 0;
}
