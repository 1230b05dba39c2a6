// What an update costs, part by part, beside what this machine can do:
//   roofline 1 sac_phi_sac der
// for so many threads and these updates of bench/updates.h, all of them if none is named; NAME_bf16 computes
// in bfloat16. The machine's peaks are measured in the same run: a product of two large matrices and a copy.
// LibTorch's own record of its operators says how long each took and on which sizes, so no formula here knows
// a network.
//   Williams et al. 2009, "Roofline: An Insightful Visual Performance Model for Multicore Architectures"
#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <ATen/Parallel.h>
#include <ATen/record_function.h>
#include <fmt/format.h>
#include <torch/types.h>

#include "agents/process.h"
#include "bench/command_line.h"
#include "bench/updates.h"
#include "cale/text.h"

namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) {
    return std::chrono::duration<double>(Clock::now() - start).count();
}

// The machine ---------------------------------------------------------------------------

/// Returns the shortest of several times of `work`, in seconds: what nothing else disturbed.
double shortest(int times, const std::function<void()>& work) {
    work();
    double best = 1e9;
    for (int i = 0; i < times; ++i) {
        const auto start = Clock::now();
        work();
        best = std::min(best, seconds_since(start));
    }
    return best;
}

struct Peaks {
    double flops = 0;  // multiplications and additions per second of a product
    double bytes = 0;  // read and written per second by a copy
};

Peaks measured_peaks(cale::Precision precision) {
    const auto type = precision == cale::Precision::bf16 ? torch::kBFloat16 : torch::kFloat32;
    constexpr std::int64_t kSize = 1'024;
    const auto a = torch::rand({kSize, kSize}).to(type), b = torch::rand({kSize, kSize}).to(type);
    auto product = torch::empty({kSize, kSize}, type);
    const double multiplied = shortest(20, [&] { at::mm_out(product, a, b); });
    constexpr std::int64_t kNumbers = 1 << 26;  // 256 MB, beyond every cache
    const auto from = torch::rand({kNumbers});
    auto to = torch::empty({kNumbers});
    const double copied = shortest(5, [&] { to.copy_(from); });
    return {.flops = 2.0 * kSize * kSize * kSize / multiplied,
            .bytes = 2.0 * kNumbers * sizeof(float) / copied};
}

// An update -----------------------------------------------------------------------------

enum Part : std::size_t { kConvolutions, kConvolutionsBackward, kProducts, kOptimiser, kTarget, kParts };
constexpr std::array<std::string_view, kParts> kPartNames{
    "convolutions", "their gradients", "products, gradients too", "optimiser", "target network"};

struct Operator {
    std::string_view name;
    Part part;
};
constexpr Operator kOperators[] = {{"aten::conv2d", kConvolutions},
                                   {"aten::convolution", kConvolutions},
                                   {"aten::convolution_backward", kConvolutionsBackward},
                                   {"aten::linear", kProducts},
                                   {"aten::matmul", kProducts},
                                   {"aten::addmm", kProducts},
                                   {"aten::mm", kProducts},
                                   {"aten::bmm", kProducts},
                                   {"aten::_fused_adamw_", kOptimiser},
                                   {"aten::_foreach_lerp_", kTarget},
                                   {"aten::_foreach_copy_", kTarget}};

struct Cost {
    double seconds = 0;
    double flops = 0;  // of convolutions and products: multiplications and additions
    double bytes = 0;  // of the others: read and written
};
using Costs = std::array<Cost, kParts>;

double bytes_of(const c10::IValue& value) {
    double bytes = 0;
    for (const auto& tensor : value.toTensorVector()) bytes += static_cast<double>(tensor.nbytes());
    return bytes;
}

/// What an operator multiplies, and what the optimiser and the target move: Adam reads parameters, gradients
/// and two moments and writes all but the gradients; a mix reads two lists and writes one, a copy one each.
void add_work(Part part, std::string_view name, c10::ArrayRef<const c10::IValue> inputs, Cost& cost) {
    const auto tensor = [&](std::size_t i) { return inputs[i].toTensor(); };
    const auto numbers = [](const torch::Tensor& of) { return static_cast<double>(of.numel()); };
    switch (part) {
        case kConvolutionsBackward: {
            // Of the input, where something before it learns, and of the weights.
            const auto wanted = inputs.back().toBoolList();
            const auto gradients = static_cast<int>(wanted[0]) + static_cast<int>(wanted[1]);
            const auto per_output = numbers(tensor(2)) / static_cast<double>(tensor(2).size(0));
            cost.flops += 2 * gradients * numbers(tensor(0)) * per_output;
            break;
        }
        case kProducts: {
            const std::size_t first = name == "aten::addmm" ? 1 : 0;
            const auto& right = tensor(first + 1);
            const auto columns = name == "aten::linear" ? right.size(0) : right.size(-1);
            cost.flops += 2 * numbers(tensor(first)) * static_cast<double>(right.dim() < 2 ? 1 : columns);
            break;
        }
        case kOptimiser:
            cost.bytes += 7 * bytes_of(inputs[0]);
            break;
        case kTarget:
            cost.bytes += (name == "aten::_foreach_copy_" ? 2 : 3) * bytes_of(inputs[0]);
            break;
        case kConvolutions:  // from its result: finish()
        case kParts:
            break;
    }
}

/// Adds up what LibTorch records on this thread. An operator inside another one is part of that one.
class Recorder {
  public:
    Recorder() {
        auto callback = at::RecordFunctionCallback(&Recorder::begin, &Recorder::finish)
                            .needsInputs(true)
                            .needsOutputs(true)
                            .scopes({at::RecordScope::FUNCTION});
        now_ = this;
        handle_ = at::addThreadLocalCallback(callback);
    }
    ~Recorder() {
        at::removeCallback(handle_);
        now_ = nullptr;
    }
    Recorder(const Recorder&) = delete;
    Recorder& operator=(const Recorder&) = delete;

    Costs costs{};

  private:
    struct Running : at::ObserverContext {
        Part part = kParts;
        double per_output = 0;  // multiplications of a convolution for one number
        Clock::time_point start;
    };

    static std::unique_ptr<at::ObserverContext> begin(const at::RecordFunction& function) {
        const std::string_view name = function.name();
        const auto* const known = std::ranges::find(kOperators, name, &Operator::name);
        if (known == std::end(kOperators) || now_->inside_) return nullptr;
        auto running = std::make_unique<Running>();
        running->part = known->part;
        if (known->part == kConvolutions) {
            const auto weight = function.inputs()[1].toTensor();
            running->per_output = static_cast<double>(weight.numel()) / static_cast<double>(weight.size(0));
        }
        add_work(known->part, name, function.inputs(), now_->costs[known->part]);
        now_->inside_ = true;
        running->start = Clock::now();
        return running;
    }

    static void finish(const at::RecordFunction& function, at::ObserverContext* context) {
        if (context == nullptr) return;
        const auto& running = static_cast<const Running&>(*context);
        auto& cost = now_->costs[running.part];
        cost.seconds += seconds_since(running.start);
        if (running.part == kConvolutions) {
            cost.flops +=
                2 * static_cast<double>(function.outputs()[0].toTensor().numel()) * running.per_output;
        }
        now_->inside_ = false;
    }

    // LibTorch calls plain functions, and those it calls for this thread.
    static thread_local Recorder* now_;
    bool inside_ = false;
    at::CallbackHandle handle_ = 0;
};
thread_local Recorder* Recorder::now_ = nullptr;

void print(std::string_view part, double seconds, double of_seconds, const std::string& rate) {
    fmt::print("  {:<24}{:>9.3f}{:>7.0f} %{}\n", part, 1e3 * seconds, 100 * seconds / of_seconds, rate);
}

void measure(const bench::NamedUpdate& named, cale::Precision precision, const Peaks& peaks) {
    const auto update = named.make({.precision = precision});
    for (int warm_up = 0; warm_up < 3; ++warm_up) update();
    const auto once = shortest(3, update);
    const int times = std::clamp(static_cast<int>(3 / once), 3, 300);
    // Alone, and once more with the record, which takes time itself.
    const auto start = Clock::now();
    for (int i = 0; i < times; ++i) update();
    const double total = seconds_since(start) / times;
    Costs costs;
    {
        Recorder recorder;
        for (int i = 0; i < times; ++i) update();
        costs = recorder.costs;
    }
    fmt::print("\n{}{}\n  {:<24}{:>9}{:>9}{:>14}{:>12}\n", named.name,
               precision == cale::Precision::bf16 ? "_bf16" : "", "part", "ms", "share", "rate",
               "of the peak");
    double known = 0, bound = 0;
    for (std::size_t part = 0; part < kParts; ++part) {
        const auto seconds = costs[part].seconds / times;
        if (seconds == 0) continue;
        const bool multiplies = costs[part].flops > 0;
        const double work = (multiplies ? costs[part].flops : costs[part].bytes) / times;
        const double peak = multiplies ? peaks.flops : peaks.bytes;
        known += seconds;
        bound += std::min(seconds, work / peak);  // what stays in the cache is faster than a copy from memory
        print(kPartNames[part], seconds, total,
              fmt::format("{:>8.1f} {}{:>10.0f} %", work / seconds / 1e9, multiplies ? "GFLOP/s" : "GB/s   ",
                          100 * work / seconds / peak));
    }
    const double others = total - known;
    print("all else", others, total, "");
    print("the update", total, total, "");
    print("with parts at the peak", bound + others, total, "");
    print("and without all else", bound, total, "");
}

std::pair<const bench::NamedUpdate*, cale::Precision> named(const std::vector<bench::NamedUpdate>& all,
                                                            std::string_view name) {
    constexpr std::string_view kBf16 = "_bf16";
    const bool bf16 = name.ends_with(kBf16);
    const auto plain = bf16 ? name.substr(0, name.size() - kBf16.size()) : name;
    const auto found = std::ranges::find(all, plain, &bench::NamedUpdate::name);
    if (found != all.end()) return {&*found, bf16 ? cale::Precision::bf16 : cale::Precision::float32};
    std::string names;
    for (const auto& update : all) names += ' ' + update.name;
    throw std::invalid_argument("there is no update '" + std::string(name) + "': the updates are" + names);
}

int roofline(int argc, char** argv) {
    if (argc < 2) return bench::kUsage;
    const auto threads = bench::whole_number("THREADS", argv[1], 1, 1'024);
    const auto all = bench::updates();
    std::vector<std::pair<const bench::NamedUpdate*, cale::Precision>> chosen;
    for (int i = 2; i < argc; ++i) chosen.push_back(named(all, argv[i]));
    if (chosen.empty())
        for (const auto& update : all) chosen.emplace_back(&update, cale::Precision::float32);
    cale::prepare_process_for_training();
    at::set_num_threads(static_cast<int>(threads));
    for (const auto precision : {cale::Precision::float32, cale::Precision::bf16}) {
        const bool needed = std::ranges::count(chosen, precision, [](const auto& c) { return c.second; }) > 0;
        if (!needed) continue;
        const auto peaks = measured_peaks(precision);
        fmt::print("{}: a product {:.1f} GFLOP/s{}, a copy {:.1f} GB/s\n", cale::counted(threads, "thread"),
                   peaks.flops / 1e9, precision == cale::Precision::bf16 ? " in bfloat16" : "",
                   peaks.bytes / 1e9);
        for (const auto& [update, its_precision] : chosen)
            if (its_precision == precision) measure(*update, precision, peaks);
    }
    return 0;
}

}  // namespace

int main(int argc, char** argv) {
    return bench::run("roofline THREADS [UPDATE ...]", roofline, argc, argv);
}
