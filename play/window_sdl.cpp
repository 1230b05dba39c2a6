#include <cstdlib>
#include <stdexcept>
#include <string>
#include <string_view>

#include <SDL.h>
#include <fmt/format.h>

#include "play/window.h"

namespace cale {
namespace {

/// Frees what SDL made.
struct Free {
    void operator()(SDL_Window* window) const { SDL_DestroyWindow(window); }
    void operator()(SDL_Renderer* renderer) const { SDL_DestroyRenderer(renderer); }
    void operator()(SDL_Texture* texture) const { SDL_DestroyTexture(texture); }
};
template <class T>
using Owned = std::unique_ptr<T, Free>;

template <class T>
T* require(T* made, std::string_view what) {
    if (made == nullptr) throw std::runtime_error(fmt::format("no {}: {}", what, SDL_GetError()));
    return made;
}

/// Where SDL finds no display, Debian's takes a driver that shows nothing, without having been asked for it.
bool is_invisible(std::string_view driver) {
    const char* const asked = std::getenv("SDL_VIDEODRIVER");
    return (driver == "offscreen" || driver == "dummy") && (asked == nullptr || *asked == '\0');
}

/// SDL itself.
struct Video {
    Video() {
        // Without this folder there is no Wayland, whose library would complain of that by itself.
        if (std::getenv("XDG_RUNTIME_DIR") == nullptr)
            SDL_SetHint(SDL_HINT_VIDEODRIVER, "x11,kmsdrm,offscreen");
        if (SDL_Init(SDL_INIT_VIDEO) != 0)
            throw std::runtime_error(fmt::format("there is no display: {}", SDL_GetError()));
        const std::string driver = SDL_GetCurrentVideoDriver();
        if (!is_invisible(driver)) return;
        SDL_Quit();
        throw std::runtime_error(
            fmt::format("there is no display: SDL offers only its driver '{}', which shows nothing", driver));
    }
    ~Video() { SDL_Quit(); }
    Video(const Video&) = delete;
    Video& operator=(const Video&) = delete;
};

}  // namespace

struct Window::Impl {
    Impl(int picture_width, int picture_height, const Dial& joystick)
        : width(picture_width), height(picture_height), dial(joystick) {
        // A picture is scaled to the window, and SDL says where the mouse is in the picture's pixels.
        SDL_RenderSetLogicalSize(renderer.get(), width, height);
    }

    void handle(const SDL_Event& event, Hands& hands, Command& command) {
        switch (event.type) {
            case SDL_QUIT:
                command = Command::quit;
                break;
            case SDL_KEYDOWN:
            case SDL_KEYUP: {
                const char* key = SDL_GetScancodeName(event.key.keysym.scancode);
                const Command asked = press(hands, key, event.type == SDL_KEYDOWN);
                if (asked != Command::none && event.key.repeat == 0 && command != Command::quit)
                    command = asked;
                break;
            }
            case SDL_MOUSEBUTTONDOWN:
            case SDL_MOUSEBUTTONUP: {
                const bool down = event.type == SDL_MOUSEBUTTONDOWN;
                if (event.button.button == SDL_BUTTON_RIGHT) press(hands, "Right Button", down);
                if (event.button.button != SDL_BUTTON_LEFT) break;
                hands.pointer.reset();
                if (down) hands.pointer = stick_at(event.button.x, event.button.y, dial);
                break;
            }
            case SDL_MOUSEMOTION:
                if (hands.pointer) hands.pointer = stick_at(event.motion.x, event.motion.y, dial);
                break;
            case SDL_WINDOWEVENT:
                // The keys that are let go in another window are never heard of.
                if (event.window.event == SDL_WINDOWEVENT_FOCUS_LOST) hands = {.reach = hands.reach};
                break;
            default:
                break;
        }
    }

    int width;
    int height;
    Dial dial;
    Video video{};
    Owned<SDL_Window> window{require(SDL_CreateWindow("cale", SDL_WINDOWPOS_CENTERED, SDL_WINDOWPOS_CENTERED,
                                                      width, height, SDL_WINDOW_RESIZABLE),
                                     "window")};
    Owned<SDL_Renderer> renderer{require(SDL_CreateRenderer(window.get(), -1, 0), "renderer for the window")};
    Owned<SDL_Texture> texture{require(
        SDL_CreateTexture(renderer.get(), SDL_PIXELFORMAT_RGB24, SDL_TEXTUREACCESS_STREAMING, width, height),
        "picture in the window")};
};

Window::Window(int width, int height, const Dial& dial)
    : impl_(std::make_unique<Impl>(width, height, dial)) {}
Window::~Window() = default;
Window::Window(Window&&) noexcept = default;
Window& Window::operator=(Window&&) noexcept = default;

void Window::show(const Image& picture, const std::string& title) {
    if (picture.width != impl_->width || picture.height != impl_->height) {
        throw std::invalid_argument(fmt::format("a picture of {} x {} pixels in a window for {} x {}",
                                                picture.width, picture.height, impl_->width, impl_->height));
    }
    SDL_SetWindowTitle(impl_->window.get(), title.c_str());
    SDL_UpdateTexture(impl_->texture.get(), nullptr, picture.rgb.data(), 3 * picture.width);
    SDL_RenderClear(impl_->renderer.get());
    SDL_RenderCopy(impl_->renderer.get(), impl_->texture.get(), nullptr, nullptr);
    SDL_RenderPresent(impl_->renderer.get());
}

Command Window::poll(Hands& hands) {
    Command command = Command::none;
    for (SDL_Event event; SDL_PollEvent(&event) != 0;) impl_->handle(event, hands, command);
    return command;
}

}  // namespace cale
