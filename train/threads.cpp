#include "train/threads.h"

#include <algorithm>
#include <chrono>
#include <limits>
#include <vector>

#include <ATen/Parallel.h>
#include <torch/types.h>

namespace cale {
namespace {

constexpr double kWorthwhile = 1.25;

/// The fastest of a few: what disturbs a measurement makes it longer.
double seconds_of_convolution(int threads) {
    at::set_num_threads(threads);
    const auto x = torch::ones({32, 32, 42, 42}).contiguous(at::MemoryFormat::ChannelsLast).requires_grad_();
    const auto weight = torch::ones({32, 32, 3, 3}).requires_grad_();
    double fastest = std::numeric_limits<double>::infinity();
    for (int repetition = 0; repetition < 4; ++repetition) {
        const auto start = std::chrono::steady_clock::now();
        at::conv2d(x, weight, {}, 1, 1).sum().backward();
        const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - start;
        if (repetition > 0) fastest = std::min(fastest, taken.count());
    }
    return fastest;
}

}  // namespace

bool multiplies_bf16() {
#if defined(__x86_64__)
    return __builtin_cpu_supports("avx512bf16");
#else
    return false;
#endif
}

int worthwhile_threads(std::span<const ThreadTime> times) {
    auto chosen = times.front();
    for (const auto& more : times.subspan(1)) {
        if (chosen.seconds < kWorthwhile * more.seconds) break;
        chosen = more;
    }
    return chosen.threads;
}

int measured_threads(int most) {
    if (most <= 1) return 1;
    std::vector<ThreadTime> times;
    for (int threads = 1; threads < 2 * most; threads *= 2) {
        const int used = std::min(threads, most);
        times.push_back({used, seconds_of_convolution(used)});
    }
    return worthwhile_threads(times);
}

}  // namespace cale
