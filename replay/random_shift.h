// Data augmentation of a batch: random shifts of the frames.
//   Yarats et al. 2021, "Image Augmentation Is All You Need" (DrQ), section 3.1
#pragma once

#include <cstdint>

#include <ATen/core/Generator.h>
#include <torch/types.h>

namespace cale {

/// Returns frames [B, stack, H, W] uint8 in which every observation is shifted by its own number of pixels,
/// from -pad to pad along each axis, all of them equally likely; the border's pixels fill what is uncovered:
/// a padding by replication and a random crop. All frames of an observation move together. Throws
/// std::invalid_argument for frames of another shape or type and for a negative pad.
torch::Tensor random_shift(const torch::Tensor& frames, std::int64_t pad, const at::Generator& random);

/// The same by `shifts` [B, 2] int64, rows and columns on the CPU or on the frames' device: pixel (i, j) of a
/// result is pixel (i + rows, j + columns) of the frames. Throws std::invalid_argument for other shapes or
/// types.
torch::Tensor shifted(const torch::Tensor& frames, const torch::Tensor& shifts);
/// The same on any device, by operators of LibTorch: what shifted() does with frames that are not on the CPU.
torch::Tensor shifted_by_index(const torch::Tensor& frames, const torch::Tensor& shifts);

}  // namespace cale
