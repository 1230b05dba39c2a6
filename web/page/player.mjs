// Plays a session frame by frame at the console's pace, 60 a second, times the speed.
const framesPerSecond = 60;
const longestRepaint = 12;  // milliseconds of one repaint's time that emulation may take

export class Player {
    speed = 1;
    paused = true;
    moment = null;    // the newest agent step; null before the first
    frame = 0;        // of it, shown now
    played = 0;       // frames since the page was opened
    #session;
    #hand;
    #stepped;
    #due = 0;         // frames
    #before = null;   // time of the last repaint

    /** `stepped` is called after each agent step. */
    constructor(session, hand, stepped) {
        this.#session = session;
        this.#hand = hand;
        this.#stepped = stepped;
    }

    /** Starts a new game. Throws what Session.start() throws. */
    start(changes, seed) {
        this.#session.start(changes, seed);
        this.moment = null;
        this.frame = 0;
        this.#due = 0;
    }

    /** One agent step at once. */
    step() {
        this.#decide();
        this.played += this.#session.frameCount() - 1;
        this.frame = this.#session.frameCount() - 1;
    }

    /** Plays what is due at `now`, in milliseconds. Returns whether there is something new to see. */
    advance(now) {
        const passed = this.#before === null ? 0 : Math.min(250, now - this.#before);
        this.#before = now;
        if (this.paused) return false;
        this.#due += passed / 1000 * framesPerSecond * this.speed;
        const played = this.played, begun = performance.now();
        // A screen repaints a little more or less often than 60 times a second: half a frame may be early.
        while (this.#due >= 0.5) {
            this.#due -= 1;
            if (this.moment && this.frame + 1 < this.#session.frameCount()) {
                ++this.frame;
                ++this.played;
            } else {
                this.#decide();
            }
            if (performance.now() - begun > longestRepaint) this.#due = Math.min(this.#due, 0);  // too slow: not made up for
        }
        return this.played !== played;
    }

    #decide() {
        const action = this.#hand.taken ? this.#hand.takeAction() : null;
        this.moment = action ? this.#session.stepByHand(action.radius, action.theta, action.fire) : this.#session.step();
        this.frame = 0;
        ++this.played;
        this.#stepped(this.moment);
    }
}
