// How many threads tensors are worth on this machine, now.
#pragma once

#include <span>

namespace cale {

/// What so many threads took, in seconds.
struct ThreadTime {
    int threads = 1;
    double seconds = 0;
};

/// The number of threads to use: twice as many (1, 2, 4, ...) are taken as long as they are a quarter
/// faster. A core that gains less is better left to the environments and to other runs.
/// `times`: ascending threads, at least one.
int worthwhile_threads(std::span<const ThreadTime> times);

/// Measures a convolution of phi_sac forwards and backwards, for a fraction of a second, on 1, 2, 4, ...
/// up to `most` threads. Leaves LibTorch's number of threads changed.
int measured_threads(int most);

}  // namespace cale
