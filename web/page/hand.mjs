// A person's hand on the joystick: keys, a pointer on the dial, a gamepad. Whatever moves takes over from the policy,
// until it is given back. Keys do what they do in `cale play` (play/keyboard.cpp).
import { actionAt } from './joystick.mjs';

const controls = {
    ArrowUp: 'up', KeyW: 'up', ArrowDown: 'down', KeyS: 'down', ArrowLeft: 'left', KeyA: 'left', ArrowRight: 'right',
    KeyD: 'right', Space: 'fire', ShiftLeft: 'half', ShiftRight: 'half',
};
const deadZone = 0.15;      // of an analog stick at rest
const movedOnPurpose = 0.3; // of one that takes over
const fireButtons = [0, 1, 2, 3], startButton = 9;

const isPressed = (gamepad, button) => Boolean(gamepad?.buttons[button]?.pressed);
const deflection = ({ axes: [x = 0, y = 0] }) => Math.hypot(x, y);

/** Returns whether somebody moves this gamepad's stick or presses one of its buttons that do something. */
export function isUsed(gamepad) {
    return deflection(gamepad) > movedOnPurpose || [...fireButtons, startButton].some((button) => isPressed(gamepad, button));
}

export class Hand {
    taken = false;
    #keys = new Set();    // held down; two may do the same
    #tapped = new Set();  // pressed since the last decision, held still or not
    #reach = 1;
    #pointer = null;      // {x, y}, where it holds the stick
    #pointerFires = false;
    #pointerFired = false;  // since the last decision
    #ignored = { stick: false, fire: false };  // what a pointer still held when the hand gave back
    #source = 'keys';     // of the stick: 'keys' or 'pad'; a pointer goes before either
    #pad = { x: 0, y: 0, fire: false, start: false };
    #changed;
    #mayTake;

    /** `changed` is called when the hand takes over or gives back; it takes over only while `mayTake()` says so. */
    constructor(changed, mayTake) {
        this.#changed = changed;
        this.#mayTake = mayTake;
    }

    take(source = this.#source) {
        this.#source = source;
        if (this.taken || !this.#mayTake()) return;
        this.taken = true;
        this.#changed();
    }

    giveBack() {
        this.#ignored = { stick: this.#pointer !== null, fire: this.#pointerFires };
        this.release();
        if (!this.taken) return;
        this.taken = false;
        this.#changed();
    }

    /** Lets go of everything: what is released in another window is never heard of. */
    release() {
        this.#keys.clear();
        this.#tapped.clear();
        this.#pointer = null;
        this.#pointerFires = false;
        this.#pointerFired = false;
    }

    /** Handles a key by its `code`; `repeated` while it is held. Returns whether it is one of the joystick's. */
    key(code, down, repeated = false) {
        const control = controls[code];
        if (control) {
            if (repeated && !this.#keys.has(code)) return true;  // held since before the hand let go of it
            if (down) this.#keys.add(code);
            else this.#keys.delete(code);
            if (down && control !== 'half') this.take(control === 'fire' ? undefined : 'keys');
            if (down && !repeated && this.taken) this.#tapped.add(code);
            return true;
        }
        const digit = /^(?:Digit|Numpad)(\d)$/.exec(code);
        if (digit && down) this.#reach = digit[1] === '0' ? 1 : digit[1] / 10;
        return digit !== null;
    }

    /** A pointer holds the stick at (x, y), or, without these, lets go of it. */
    point(x, y) {
        if (x === undefined) this.#ignored.stick = false;
        this.#pointer = x === undefined || this.#ignored.stick ? null : { x, y };
        if (this.#pointer) this.take('keys');
    }

    pointerFires(down) {
        if (!down) this.#ignored.fire = false;
        this.#pointerFires = down && !this.#ignored.fire;
        if (!this.#pointerFires) return;
        this.take();
        this.#pointerFired = this.taken;
    }

    /** Reads a gamepad, if there is one. */
    poll(gamepad) {
        const before = this.#pad;
        const pressed = (button) => isPressed(gamepad, button);
        const [x = 0, down = 0] = gamepad?.axes ?? [];
        const far = gamepad ? deflection(gamepad) : 0;
        const reach = far <= deadZone ? 0 : Math.min(1, (far - deadZone) / (1 - deadZone)) / far;
        this.#pad = {
            x: reach * x, y: -reach * down, fire: fireButtons.some(pressed), start: pressed(startButton),
            moved: far > movedOnPurpose,
        };
        const pushed = (this.#pad.moved && !before.moved) || (this.#pad.fire && !before.fire);
        // A stick that is still held has the joystick again once keys and pointer have let go.
        const continues = this.taken && this.#pad.moved && this.#keys.size === 0 && !this.#pointer;
        if (pushed || continues) this.take('pad');
        if (this.#pad.start && !before.start) this.giveBack();
    }

    /** Returns (r, theta, fire); opposite keys cancel out. */
    #actionOf(keys, pointerFires) {
        const holds = (control) => Number([...keys].some((code) => controls[code] === control));
        const pad = this.#source === 'pad';
        const fire = holds('fire') || pointerFires || (pad && this.#pad.fire) ? 1 : 0;
        if (this.#pointer) return actionAt(this.#pointer.x, this.#pointer.y, fire);
        if (pad) return actionAt(this.#pad.x, this.#pad.y, fire);
        const x = holds('right') - holds('left');
        const y = holds('up') - holds('down');
        const far = Math.hypot(x, y) || 1;
        const reach = holds('half') ? this.#reach / 2 : this.#reach;
        return actionAt(x / far * reach, y / far * reach, fire);
    }

    /** The action of what is held now. */
    action() {
        return this.#actionOf(this.#keys, this.#pointerFires);
    }

    /** The action of the next decision, in which what was pressed and let go of since the last one counts, too. */
    takeAction() {
        const action = this.#actionOf([...this.#keys, ...this.#tapped], this.#pointerFires || this.#pointerFired);
        this.#tapped.clear();
        this.#pointerFired = false;
        return action;
    }
}
