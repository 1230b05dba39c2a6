#include "replay/random_shift.h"

#include <algorithm>
#include <cstring>
#include <stdexcept>

#include <ATen/Parallel.h>

#include "replay/replay.h"

namespace cale {
namespace {

/// Writes to `to` the plane whose pixel (i, j) is pixel (i + row_shift, j + column_shift) of `from`; beyond
/// the border its nearest pixel.
void shift_plane(const std::uint8_t* from, std::uint8_t* to, std::int64_t rows, std::int64_t columns,
                 std::int64_t row_shift, std::int64_t column_shift) {
    const auto first = std::clamp<std::int64_t>(-column_shift, 0, columns),
               last = std::clamp(columns - column_shift, first, columns);
    for (std::int64_t i = 0; i < rows; ++i, to += columns) {
        const auto* const row = from + std::clamp<std::int64_t>(i + row_shift, 0, rows - 1) * columns;
        std::memset(to, row[0], static_cast<std::size_t>(first));
        std::memcpy(to + first, row + first + column_shift, static_cast<std::size_t>(last - first));
        std::memset(to + last, row[columns - 1], static_cast<std::size_t>(columns - last));
    }
}

torch::Tensor shifted_on_cpu(const torch::Tensor& frames, const torch::Tensor& shifts) {
    const auto source = frames.contiguous();
    const auto by = shifts.cpu().contiguous();
    auto result = torch::empty_like(source);
    const auto planes = source.size(1), rows = source.size(2), columns = source.size(3);
    const auto size = rows * columns;
    const auto* const from = source.const_data_ptr<std::uint8_t>();
    auto* const to = result.data_ptr<std::uint8_t>();
    const auto* const shift = by.const_data_ptr<std::int64_t>();
    at::parallel_for(0, source.size(0), /*grain_size=*/8, [&](std::int64_t begin, std::int64_t end) {
        for (std::int64_t plane = begin * planes; plane < end * planes; ++plane) {
            const auto* const own = shift + plane / planes * 2;
            shift_plane(from + plane * size, to + plane * size, rows, columns, own[0], own[1]);
        }
    });
    return result;
}

}  // namespace

torch::Tensor shifted_by_index(const torch::Tensor& frames, const torch::Tensor& shifts) {
    const auto moved = shifts.to(frames.device());
    const auto index = [&](std::int64_t axis) {
        const auto size = frames.size(axis + 2);
        return (torch::arange(size, moved.options()) + moved.select(1, axis).unsqueeze(1)).clamp(0, size - 1);
    };
    const auto rows = index(0).view({frames.size(0), 1, -1, 1}),
               columns = index(1).view({frames.size(0), 1, 1, -1});
    return frames.gather(2, rows.expand(frames.sizes())).gather(3, columns.expand(frames.sizes()));
}

torch::Tensor shifted(const torch::Tensor& frames, const torch::Tensor& shifts) {
    if (frames.dim() != 4 || frames.scalar_type() != torch::kUInt8)
        throw std::invalid_argument("random_shift moves frames [B, stack, rows, columns] of type uint8");
    if (shifts.sizes() != at::IntArrayRef{frames.size(0), 2} || shifts.scalar_type() != torch::kInt64)
        throw std::invalid_argument("random_shift moves B observations by shifts [B, 2] of type int64");
    return frames.is_cpu() ? shifted_on_cpu(frames, shifts) : shifted_by_index(frames, shifts);
}

torch::Tensor random_shift(const torch::Tensor& frames, std::int64_t pad, const at::Generator& random) {
    if (pad < 0) throw std::invalid_argument("random_shift needs a pad of at least 0");
    const auto options = torch::dtype(torch::kInt64).device(frames.device());
    return shifted(frames, torch::randint(-pad, pad + 1, {frames.size(0), 2}, random, options));
}

Batch randomly_shifted(Batch batch, std::int64_t pad, const at::Generator& random) {
    batch.observation = random_shift(batch.observation, pad, random);
    batch.next_observation = random_shift(batch.next_observation, pad, random);
    return batch;
}

}  // namespace cale
