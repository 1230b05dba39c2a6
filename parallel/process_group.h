// Several processes, on one machine or many, that train one agent together through LibTorch's c10d.
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <c10/core/Device.h>
#include <torch/types.h>

namespace cale {

/// Which of a run's processes this one is, and where they rendezvous.
struct ProcessRank {
    int rank = 0;                       // 0 is the first
    int size = 1;                       // how many there are
    int local_rank = 0;                 // among those on this machine
    int local_size = 1;                 // how many on this machine
    std::string master_address = {};    // the machine of rank 0
    std::uint16_t master_port = 29500;  // where it listens
};

/// What torchrun says, and what a line with srun can say, in the environment: WORLD_SIZE, RANK, MASTER_ADDR,
/// MASTER_PORT, and for several on a machine LOCAL_RANK and LOCAL_WORLD_SIZE. None where WORLD_SIZE is
/// missing or 1. Throws std::invalid_argument, naming the variable, where one is missing or makes no sense.
std::optional<ProcessRank> rank_from_environment();

/// Copies are the same group. All processes must make the same calls in the same order. A call ends with
/// std::runtime_error, in one sentence, when another process ends or none of them answers in time.
class ProcessGroup {
  public:
    /// Tensors by name.
    using TensorMap = std::map<std::string, torch::Tensor>;

    /// One process, alone: nothing below waits or changes anything.
    ProcessGroup() = default;
    /// Connects to the others. Tensors on the CPU travel by Gloo; those on `device`, if it is a CUDA device,
    /// by NCCL. `timeout`: how long a call waits for the others, which may be evaluating meanwhile. Throws
    /// std::invalid_argument for a CUDA device where cale was built without NCCL.
    ProcessGroup(const ProcessRank& process, c10::Device device,
                 std::chrono::milliseconds timeout = std::chrono::minutes(30));

    int rank() const;                            // this one's number, from 0
    int size() const;                            // how many there are
    bool single() const { return size() == 1; }  // whether this is the only one
    /// The one that writes logs and checkpoints.
    bool first() const { return rank() == 0; }

    /// Replaces each tensor, in place, by its sum over all processes, with the same bits everywhere. One
    /// message for all of them, which are of one type and device.
    void sum(const std::vector<torch::Tensor>& tensors) const;
    /// Whether it is true anywhere.
    bool any(bool here) const;
    /// Everybody's map, by rank, for the first process, on the CPU; the others get an empty list.
    std::vector<TensorMap> gather(const TensorMap& own) const;
    /// Throws std::runtime_error with `complaint` everywhere unless `text` is the same in all processes.
    void require_same(const std::string& text, const std::string& complaint) const;

  private:
    struct Impl;
    std::shared_ptr<const Impl> impl_;
};

/// Mean and deviation of a sample that is spread over the processes.
struct Moments {
    std::int64_t count;             // of the whole sample
    torch::Tensor mean, deviation;  // [], of the sample's type; the deviation divides by count
};
/// Returns the moments of all processes' parts together.
Moments moments(const torch::Tensor& part, const ProcessGroup& processes);

}  // namespace cale
