#include "agents/sacd.h"
#include "train/program.h"

int main(int argc, char** argv) {
    return cale::run_program(
        "sacd",
        "Trains a discrete soft actor-critic (SAC-D) agent on an Atari 2600 game. Preset: "
        "configs/sacd/atari100k.yaml; without one a run has 200 million frames.",
        cale::make_sacd, argc, argv);
}
