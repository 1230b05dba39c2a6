#include "agents/sacd.h"
#include "train/program.h"

int main(int argc, char** argv) {
    return cale::run_program("sacd", "Trains discrete soft actor-critic on an Atari 2600 game.",
                             cale::make_sacd, argc, argv);
}
