// A second copy of a replay's frames, on the training device: each frame is transferred once; a batch
// transfers only the indices of its frames.
#pragma once

#include <c10/core/Event.h>
#include <torch/types.h>

#include "replay/frame_ring.h"

namespace cale {

/// Follows one replay's frames.
class FrameMirror {
  public:
    /// Throws std::runtime_error, naming device and gigabytes, where the device lacks the memory.
    FrameMirror(const ReplayConfig& config, torch::Device device);

    torch::Device device() const { return frames_.device(); }  // where the copy is

    /// Fills batch.observation and batch.next_observation, which are on device(), with the stacks of the
    /// transitions in the slots batch.index. First uploads the new frames.
    void gather(const FrameRing& ring, Batch& batch);
    /// Makes the next gather() upload all frames again, because the replay's contents were replaced.
    void forget() { seen_ = 0; }

  private:
    void follow(const FrameRing& ring);
    void wait_until_read();
    void record_read();

    torch::Tensor frames_;           // [frames_capacity + 1, H * W] as in the ring; the last one is blank
    torch::Tensor staged_;           // [some, H * W] on the host, frames being uploaded
    torch::Tensor shown_;            // [2, B, stack] int64 on the host: rows of frames_
    torch::Tensor shown_on_device_;  // the same
    c10::Event read_;                // recorded once the device has read staged_ and shown_
    FrameId seen_ = 0;               // frames before this one have been uploaded
};

}  // namespace cale
