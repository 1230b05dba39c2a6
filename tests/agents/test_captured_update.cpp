// An update runs as often as it is called, with the inputs and the random numbers of that call, whether it is
// called or replayed from a CUDA graph.
#include "agents/captured_update.h"

#include <cstdint>
#include <stdexcept>
#include <vector>

#include <gtest/gtest.h>
#include <torch/cuda.h>
#include <torch/types.h>

#include "agents/random.h"

namespace cale {
namespace {

/// More runs than a CUDA graph takes to be recorded.
constexpr int kRuns = 8;

class CapturedUpdateOn : public testing::TestWithParam<c10::DeviceType> {
  protected:
    void SetUp() override {
        if (device_.is_cuda() && !torch::cuda::is_available())
            GTEST_SKIP() << "this machine has no CUDA device";
    }

    const torch::Device device_{GetParam()};
    const at::Generator random_ =
        device_.is_cpu() || torch::cuda::is_available() ? make_generator(3, device_) : at::Generator{};
};

INSTANTIATE_TEST_SUITE_P(Devices, CapturedUpdateOn, testing::Values(torch::kCPU, torch::kCUDA),
                         [](const auto& device) {
                             return c10::DeviceTypeName(device.param, /*lower_case=*/true);
                         });

TEST_P(CapturedUpdateOn, ReadsItsInputsAnewInEveryRun) {
    auto input = torch::zeros({3}, device_), sum = torch::zeros({3}, device_);
    torch::Tensor twice;
    CapturedUpdate step(device_, {});
    for (int run = 1; run <= kRuns; ++run) {
        input.fill_(run);
        step([&] {
            sum += input;
            twice = 2 * input;
        });
        EXPECT_EQ(sum.sum().item<int>(), 3 * run * (run + 1) / 2);
        EXPECT_EQ(twice[0].item<int>(), 2 * run);
    }
}

TEST_P(CapturedUpdateOn, DrawsTheNumbersThatACallDraws) {
    auto same = make_generator(3, device_);
    torch::Tensor drawn;
    CapturedUpdate step(device_, random_);
    for (int run = 0; run < kRuns; ++run) {
        step([&] { drawn = torch::randn({5}, random_, device_); });
        EXPECT_TRUE(drawn.equal(torch::randn({5}, same, device_))) << run;
    }
    EXPECT_TRUE(random_state(random_).equal(random_state(same)));
}

TEST_P(CapturedUpdateOn, DrawsOnFromARestoredState) {
    torch::Tensor drawn;
    CapturedUpdate step(device_, random_);
    const auto draw = [&] {
        step([&] { drawn = torch::randn({5}, random_, device_); });
        return drawn.clone();
    };
    std::vector<torch::Tensor> first, second;
    for (int run = 0; run < kRuns; ++run) draw();
    const auto state = random_state(random_);
    for (int run = 0; run < kRuns; ++run) first.push_back(draw());
    at::Generator(random_).set_state(state);
    step.forget();
    for (int run = 0; run < kRuns; ++run) second.push_back(draw());
    for (int run = 0; run < kRuns; ++run) EXPECT_TRUE(first[run].equal(second[run])) << run;
}

TEST_P(CapturedUpdateOn, LeavesTheDeviceUsableWhereAnUpdateThrows) {
    auto sum = torch::zeros({1}, device_);
    CapturedUpdate step(device_, {}), another(device_, {});
    const auto fail = [&] {
        sum += 1;
        throw std::runtime_error("no");
    };
    for (int run = 0; run < kRuns; ++run) EXPECT_THROW(step(fail), std::runtime_error);
    sum.zero_();
    for (int run = 1; run <= kRuns; ++run) {
        another([&] { sum += 1; });
        EXPECT_EQ(sum.item<int>(), run);
    }
}

}  // namespace
}  // namespace cale
