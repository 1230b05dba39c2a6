// What this machine is good at: how many LibTorch threads pay off, and which numbers.
#pragma once

#include <span>

namespace cale {

/// Returns whether this processor multiplies bfloat16: AVX512-BF16, which every one with AMX has. Others are
/// several times slower at it than at float32.
bool multiplies_bf16();

/// The time that a number of threads took.
struct ThreadTime {
    int threads = 1;
    double seconds = 0;
};

/// Returns the number of threads to use: doubled (1, 2, 4, ...) as long as that is a quarter faster. A core
/// that gains less is better left to the environments and to other runs. `times`: ascending threads, at least
/// one.
int worthwhile_threads(std::span<const ThreadTime> times);

/// Measures a convolution of phi_sac forwards and backwards, for a fraction of a second, on 1, 2, 4, ...
/// up to `most` threads. Leaves LibTorch's number of threads changed.
int measured_threads(int most);

}  // namespace cale
