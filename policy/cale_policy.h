/* A trained policy for programs in C and in whatever can call C. See docs/embedding.md.
 *
 * No function throws or exits. Those that can fail return 0 (or NULL) and keep one sentence on why, which
 * cale_policy_error() gives to the same thread; cale_session_due() cannot. A policy may be used by any number
 * of threads at the same time; a session belongs to one thread at a time. */
#ifndef CALE_POLICY_H
#define CALE_POLICY_H

#include <stddef.h>
#include <stdint.h>

#if defined(__GNUC__)
#define CALE_POLICY_API __attribute__((visibility("default")))
#else
#define CALE_POLICY_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* Increases when something is added; programs made for an older version keep working: the structures stay as
 * they are, and what is added are functions. */
#define CALE_POLICY_VERSION 1
CALE_POLICY_API int cale_policy_version(void);

typedef struct cale_policy cale_policy;
typedef struct cale_session cale_session;

/* One decision. radius, theta and fire are 0 where actions are numbers of joystick events (num_actions above
 * 0), but for those of "joystick" "factored". */
typedef struct {
    float radius;   /* [0, 1] */
    float theta;    /* [-pi, pi], counter-clockwise, 0 points right */
    float fire;     /* [0, 1] */
    int32_t action; /* number of an action, -1: coordinates of the joystick */
    int32_t event;  /* the joystick event, as ALE numbers its actions: 0 to 17 */
    float strength; /* how far a paddle moves: 0 to 1 */
} cale_decision;

/* What a policy is made for. */
typedef struct {
    int32_t num_actions;            /* 0: coordinates of the joystick */
    int32_t stack;                  /* frames of an observation */
    int32_t frame_height;           /* rows */
    int32_t frame_width;            /* columns */
    int32_t frame_skip;             /* emulated frames per decision */
    int32_t life_loss_ends_episode; /* 1: the stack is cleared at a lost life */
    double threshold;               /* how far the joystick must be pushed to count */
    double epsilon;                 /* of the run's own evaluations */
} cale_policy_info;

/* greedy: the likeliest, mean or most valuable action; sampled: drawn from the policy, or of noisy action
 * values the best after a draw; as evaluated: as the run's own evaluations did it. */
enum { CALE_GREEDY = 0, CALE_SAMPLED = 1, CALE_AS_EVALUATED = 2 };

/* A policy file; or its contents in memory, which may go afterwards. Nothing in it is executed. NULL on
 * failure. */
CALE_POLICY_API cale_policy* cale_policy_load(const char* path);
CALE_POLICY_API cale_policy* cale_policy_parse(const void* contents, size_t size);
/* Sessions made from it remain valid. NULL is allowed. */
CALE_POLICY_API void cale_policy_free(cale_policy* policy);

CALE_POLICY_API int cale_policy_get_info(const cale_policy* policy, cale_policy_info* info);
/* "game", "agent", "encoder", "action_space", "joystick", or what the file says of its origin: "seed",
 * "agent_steps", "config", ...; NULL, and the error as it was, for a name that it does not have. What it says
 * of its origin may be any text. Lives as long as the policy. Where "joystick" is "paddle", a decision is the
 * place of the paddle: radius * cos(theta) is -1 at the left end, 1 at the right one, and no event moves it
 * there. */
CALE_POLICY_API const char* cale_policy_text(const cale_policy* policy, const char* name);

/* A game that is being played with a policy, on screens of `screen_height` rows (210 in nearly all games) and
 * 160 columns. `seed` is for the draws, where there are any. Of frames that are neither 84x84 nor memory a
 * session takes observations only, in cale_session_act_on(). NULL on failure. */
CALE_POLICY_API cale_session* cale_session_new(const cale_policy* policy, int32_t screen_height,
                                               uint64_t seed);
/* NULL is allowed. */
CALE_POLICY_API void cale_session_free(cale_session* session);

/* A game has begun; one more emulated frame; a life was lost with the frame seen last, which must be said
 * where life_loss_ends_episode. A screen is gray (a byte per pixel) or RGB (three), `size` its bytes; where
 * frame_height is 1, it is the console's memory. */
CALE_POLICY_API int cale_session_start(cale_session* session, const uint8_t* screen, size_t size);
CALE_POLICY_API int cale_session_see(cale_session* session, const uint8_t* screen, size_t size);
CALE_POLICY_API int cale_session_lose_life(cale_session* session);
/* 1: a decision is due: at the start, then after every frame_skip frames. 0: none is, no game has begun, or
 * `session` is NULL. */
CALE_POLICY_API int cale_session_due(const cale_session* session);
/* The decision that is due; where none is, one on the newest observation. */
CALE_POLICY_API int cale_session_act(cale_session* session, int choice, cale_decision* decision);
/* A decision on an observation of the caller's own, [stack, frame_height, frame_width] bytes. */
CALE_POLICY_API int cale_session_act_on(cale_session* session, const uint8_t* observation, size_t size,
                                        int choice, cale_decision* decision);

/* What went wrong in the last call of this thread that failed; "" if none did. Lives until the next one that
 * fails. */
CALE_POLICY_API const char* cale_policy_error(void);

#ifdef __cplusplus
}
#endif

#endif
