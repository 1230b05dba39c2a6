#include "fake_program.h"

#include <fmt/format.h>

namespace test {
namespace {

constexpr const char* kProgram = R"sh(#!/bin/bash
here=$(dirname "$0")
resume= print=
defaults() { mode=fast size=1 loss=huber rate=1e-4 every=10 steps=100 rom_dir= env=; }
check() {
    if [ "$size" = huge ]; then
        echo "train_fake: --set agent.size=huge: agent.size must be a number, not 'huge'" >&2
        exit 2
    fi
    if [ "$size" = 9 ] && [ "$loss" = mse ]; then
        echo "train_fake: agent.size is 9, which is not for agent.loss = mse" >&2
        exit 2
    fi
}
config() {
    printf 'env:\n  rom_dir: "%s"\n%sagent:\n  mode: %s\n  size: %s\n' "$rom_dir" "$env" "$mode" "$size"
    printf '  loss: %s\n  rate: %s\n  replay_capacity: 1000000\n' "$loss" "$rate"
    printf 'train:\n  total_steps: %s\neval:\n  episodes: 0\nlog:\n  every: %s\n' "$steps" "$every"
}
defaults
while [ $# -gt 0 ]; do
    case $1 in
        --print-config) print=1 ;;
        --or) check; config; echo ---; defaults ;;
        --resume) resume=1 ;;
        --no-progress) ;;
        --run-dir) dir=$2; shift ;;
        --threads | --device | --config) shift ;;
        agent.mode=*) mode=${1#*=} ;;
        agent.size=*) size=${1#*=} ;;
        agent.loss=*) loss=${1#*=} ;;
        agent.rate=*) rate=${1#*=} ;;
        agent.replay_capacity=*) ;;
        log.every=*) every=${1#*=} ;;
        train.total_steps=*) steps=${1#*=} ;;
        env.rom_dir=*) rom_dir=${1#*=} ;;
        env.game=* | train.seed=*) ;;
        env.*) key=${1%%=*}; env="$env  ${key#env.}: ${1#*=}"$'\n' ;;
        *) echo "train_fake: --set $1: unknown key '${1%%=*}'" >&2; exit 2 ;;
    esac
    shift
done
check
if [ -n "$print" ]; then config; exit; fi
checkpoint() { mkdir -p "$dir/checkpoints/step_000000$1"; }
finish() {
    printf 'global_step,seconds,steps_per_second,charts/avg_episodic_return\n%s,1,50,7.5\n' "$steps" \
        >"$dir/progress.csv"
    printf '#{}\nr,global_step\n7.5,%s\n' "$steps" >"$dir/episodes.csv"
    checkpoint "$steps"
    exit 0
}
if [ -n "$resume" ]; then echo resumed; else echo "started with $(ls "$dir" | tr '\n' ' ')"; fi
echo "{}" >"$dir/metadata.json"
[ -e "$dir/episodes.csv" ] || printf '#{}\nr,global_step\n' >"$dir/episodes.csv"
config >"$dir/config.yaml.tmp-1"
mv "$dir/config.yaml.tmp-1" "$dir/config.yaml"
case $mode in
    fast) finish ;;
    slow)
        ready=$here/ready_${dir##*/}
        trap 'rm -f "$ready"; checkpoint 050; echo "Interrupted"; exit 130' INT TERM
        touch "$ready"
        while [ ! -e "$here/go" ]; do sleep 0.02; done
        finish ;;
    fail_once)
        [ -n "$resume" ] && finish
        checkpoint 050; echo "it broke"; exit 1 ;;
    fail) echo "it breaks always"; exit 1 ;;
    unresumable) echo "another configuration"; exit 3 ;;
    diverge) echo "a loss became nan"; exit 4 ;;
    killed_once)
        [ -e "$here/killed" ] && finish
        touch "$here/killed"; kill -9 $$ ;;
esac
)sh";

}  // namespace

FakeProgram::FakeProgram() {
    write_script("train_fake", kProgram);
    write("roms/pong.bin", "");
}

std::vector<cale::PlannedRun> FakeProgram::runs(const std::vector<std::string>& modes) const {
    std::vector<cale::PlannedRun> runs;
    for (std::size_t i = 0; i < modes.size(); ++i) {
        runs.push_back({.run = {.name = fmt::format("{}_{}", modes[i], i),
                                .agent = "fake",
                                .config = {},
                                .game = "Pong",
                                .settings = {{"agent.mode", modes[i]}}},
                        .program = path() / "train_fake",
                        .end = {.total_steps = 100, .evaluates = false},
                        .memory = 1});
    }
    return runs;
}

std::filesystem::path FakeProgram::write_script(const std::string& name, const std::string& text) const {
    const auto file = write(name, text);
    std::filesystem::permissions(file, std::filesystem::perms::owner_all);
    return file;
}

}  // namespace test
