#include "parallel/process_group.h"

#include <algorithm>
#include <cstdlib>
#include <exception>
#include <stdexcept>
#include <string_view>
#include <utility>

#include <torch/serialize.h>
#include <torch/types.h>
#include <torch/utils.h>
#include <torch/csrc/distributed/c10d/PrefixStore.hpp>
#include <torch/csrc/distributed/c10d/ProcessGroupGloo.hpp>
#include <torch/csrc/distributed/c10d/TCPStore.hpp>

#include "cale/number.h"
#include "parallel/device_backend.h"

namespace cale {
namespace {

using Bytes = std::vector<char>;

/// How long a process waits for the others to be started.
constexpr std::chrono::milliseconds kStartTimeout = std::chrono::minutes(5);

std::optional<std::string> variable(const char* name) {
    const char* value = std::getenv(name);
    return value != nullptr && *value != '\0' ? std::optional<std::string>(value) : std::nullopt;
}

int number(const char* name, const std::string& text, int low, int high) {
    const auto value = number_in<int>(text);
    if (value && *value >= low && *value <= high) return *value;
    throw std::invalid_argument(std::string(name) + "=" + text + ": must be a whole number from " +
                                std::to_string(low) + " to " + std::to_string(high));
}

std::string required(const char* name, int size) {
    if (const auto value = variable(name)) return *value;
    throw std::invalid_argument("WORLD_SIZE=" + std::to_string(size) + " asks for several processes, but " +
                                name + " is not set; start them with torchrun, or set it as " +
                                "docs/distributed.md shows");
}

/// The part of an error's text that says what happened, without where in Gloo's source that was.
std::string reason(const std::exception& error) {
    const auto* of_torch = dynamic_cast<const c10::Error*>(&error);
    std::string text = of_torch != nullptr ? of_torch->what_without_backtrace() : error.what();
    if (text.starts_with('[')) text.erase(0, text.find("] ") + 2);
    return text.substr(0, text.find('\n'));
}

/// Where the processes find each other. torchrun serves this store itself, a new one after each restart.
c10::intrusive_ptr<c10d::Store> rendezvous_store(const ProcessRank& process) {
    const bool served = variable("TORCHELASTIC_USE_AGENT_STORE") == "True";
    c10d::TCPStoreOptions options;
    options.port = process.master_port;
    options.isServer = process.rank == 0 && !served;
    options.waitWorkers = !served;
    if (!served) options.numWorkers = static_cast<std::size_t>(process.size);
    options.timeout = kStartTimeout;
    auto store = c10::make_intrusive<c10d::TCPStore>(process.master_address, options);
    const auto restart = variable("TORCHELASTIC_RESTART_COUNT").value_or("0");
    return c10::make_intrusive<c10d::PrefixStore>("cale/" + restart, store);
}

torch::Tensor tensor_of(const Bytes& bytes) {
    auto tensor = torch::empty({static_cast<std::int64_t>(bytes.size())}, torch::kUInt8);
    std::copy(bytes.begin(), bytes.end(), reinterpret_cast<char*>(tensor.data_ptr<std::uint8_t>()));
    return tensor;
}

Bytes bytes_of(const torch::Tensor& tensor, std::int64_t count) {
    const auto* data = reinterpret_cast<const char*>(tensor.const_data_ptr<std::uint8_t>());
    return {data, data + count};
}

Bytes packed(const ProcessGroup::TensorMap& map) {
    c10::Dict<std::string, torch::Tensor> dictionary;
    for (const auto& [name, tensor] : map) dictionary.insert(name, tensor);
    return torch::pickle_save(dictionary);
}

ProcessGroup::TensorMap unpacked(const Bytes& bytes) {
    ProcessGroup::TensorMap map;
    for (const auto& entry : torch::pickle_load(bytes).toGenericDict())
        map[entry.key().toStringRef()] = entry.value().toTensor();
    return map;
}

}  // namespace

std::optional<ProcessRank> rank_from_environment() {
    const auto world = variable("WORLD_SIZE");
    if (!world) return std::nullopt;
    ProcessRank process;
    process.size = number("WORLD_SIZE", *world, 1, 4096);
    if (process.size == 1) return std::nullopt;
    process.rank = number("RANK", required("RANK", process.size), 0, process.size - 1);
    process.master_address = required("MASTER_ADDR", process.size);
    process.master_port =
        static_cast<std::uint16_t>(number("MASTER_PORT", required("MASTER_PORT", process.size), 1, 65'535));
    process.local_size =
        number("LOCAL_WORLD_SIZE", variable("LOCAL_WORLD_SIZE").value_or("1"), 1, process.size);
    const int local_ranks = variable("LOCAL_WORLD_SIZE") ? process.local_size : process.size;
    process.local_rank = number("LOCAL_RANK", variable("LOCAL_RANK").value_or("0"), 0, local_ranks - 1);
    return process;
}

struct ProcessGroup::Impl {
    Impl(const ProcessRank& rank, c10::Device own_device, std::chrono::milliseconds timeout)
        : process(rank), device(own_device) {
        try {
            const auto store = rendezvous_store(process);
            host = c10::make_intrusive<c10d::ProcessGroupGloo>(
                c10::make_intrusive<c10d::PrefixStore>("gloo", store), process.rank, process.size,
                c10d::ProcessGroupGloo::Options::create_default(kStartTimeout));
            host->setTimeout(timeout);
            if (!device.is_cpu())
                on_device = device_backend(store, process.rank, process.size, device, timeout);
        } catch (const std::invalid_argument&) {
            throw;
        } catch (const std::exception& error) {
            fail("the processes did not find each other at " + process.master_address + ":" +
                     std::to_string(process.master_port) +
                     "; start all of them within five minutes, with the same free MASTER_PORT",
                 error);
        }
    }

    [[noreturn]] void fail(const std::string& what, const std::exception& error) const {
        throw std::runtime_error("process " + std::to_string(process.rank) + " of " +
                                 std::to_string(process.size) + ": " + what + ": " + reason(error));
    }

    /// Starts something that all processes do, and waits for it.
    template <class Start>
    void together(const Start& start) const {
        try {
            start()->wait();
        } catch (const std::exception& error) {
            fail(
                "another process of this run has ended or does not answer, so this one ends too; "
                "resume from the newest checkpoint with --resume",
                error);
        }
    }

    void sum(torch::Tensor tensor) const {
        std::vector<torch::Tensor> tensors{std::move(tensor)};
        together([&] { return (tensors.front().is_cpu() ? host : on_device)->allreduce(tensors); });
    }

    /// Everybody's number, by rank.
    torch::Tensor numbers(std::int64_t own) const {
        auto all = torch::zeros({process.size}, torch::kInt64);
        all[process.rank] = own;
        sum(all);
        return all;
    }

    std::vector<Bytes> gather(const Bytes& own) const {
        const auto sizes = numbers(static_cast<std::int64_t>(own.size()));
        auto message = torch::zeros({sizes.max().item<std::int64_t>()}, torch::kUInt8);
        message.slice(0, 0, static_cast<std::int64_t>(own.size())).copy_(tensor_of(own));
        std::vector<torch::Tensor> inputs{message};
        std::vector<std::vector<torch::Tensor>> outputs;
        if (process.rank == 0) {
            outputs.emplace_back();
            for (int i = 0; i < process.size; ++i) outputs.front().push_back(torch::empty_like(message));
        }
        together([&] { return host->gather(outputs, inputs); });
        std::vector<Bytes> gathered;
        if (process.rank != 0) return gathered;
        for (int i = 0; i < process.size; ++i)
            gathered.push_back(
                bytes_of(outputs.front()[static_cast<std::size_t>(i)], sizes[i].item<std::int64_t>()));
        return gathered;
    }

    ProcessRank process;
    c10::Device device;
    c10::intrusive_ptr<c10d::Backend> host, on_device;
};

ProcessGroup::ProcessGroup(const ProcessRank& process, c10::Device device, std::chrono::milliseconds timeout)
    : impl_(std::make_shared<const Impl>(process, device, timeout)) {}

int ProcessGroup::rank() const {
    return impl_ ? impl_->process.rank : 0;
}
int ProcessGroup::size() const {
    return impl_ ? impl_->process.size : 1;
}

void ProcessGroup::sum(const std::vector<torch::Tensor>& tensors) const {
    if (single()) return;
    const torch::NoGradGuard no_grad;
    std::vector<torch::Tensor> flat;
    flat.reserve(tensors.size());
    for (const auto& tensor : tensors) flat.push_back(tensor.reshape(-1));
    const auto message = torch::cat(flat);
    impl_->sum(message);
    std::int64_t begin = 0;
    for (const auto& tensor : tensors) {
        tensor.copy_(message.slice(0, begin, begin + tensor.numel()).view(tensor.sizes()));
        begin += tensor.numel();
    }
}

bool ProcessGroup::any(bool here) const {
    return single() ? here : impl_->numbers(here ? 1 : 0).any().item<bool>();
}

std::vector<ProcessGroup::TensorMap> ProcessGroup::gather(const TensorMap& own) const {
    if (single()) return {own};
    std::vector<TensorMap> all;
    for (const auto& bytes : impl_->gather(packed(own))) all.push_back(unpacked(bytes));
    return all;
}

void ProcessGroup::require_same(const std::string& text, const std::string& complaint) const {
    if (single()) return;
    const auto texts = impl_->gather(Bytes(text.begin(), text.end()));
    const bool differ = std::ranges::any_of(texts, [&](const Bytes& of_another) {
        return std::string_view(of_another.data(), of_another.size()) != text;
    });
    if (any(differ)) throw std::runtime_error(complaint);
}

Moments moments(const torch::Tensor& part, const ProcessGroup& processes) {
    if (processes.single()) return {part.numel(), part.mean(), part.std(/*unbiased=*/false)};
    const auto values = part.detach().to(torch::kFloat64);
    auto sums = torch::stack({torch::full_like(values.sum(), static_cast<double>(part.numel())), values.sum(),
                              values.square().sum()});
    processes.sum({sums});
    const auto mean = sums[1] / sums[0];
    const auto variance = (sums[2] / sums[0] - mean.square()).clamp_min(0);
    return {sums[0].item<std::int64_t>(), mean.to(part.scalar_type()),
            variance.sqrt().to(part.scalar_type())};
}

}  // namespace cale
