// SAC learns the pendulum of Gymnasium (Pendulum-v1) from pictures: a task whose score is known. A policy
// that swings it up at once has a return of about -150, one that does nothing or anything at random about
// -1200.
#include <agents/sac.h>
#include <train/program.h>

#include "pendulum.h"

int main(int argc, char** argv) {
    return cale::run_program<example::PendulumConfig>(
        "sac", "Trains soft actor-critic to swing up a pendulum.", cale::make_sac, argc, argv);
}
