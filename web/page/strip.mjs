// The newest decisions as a strip: in which zone each put the stick, the button, points and lost lives.
import { palette, prepare } from './canvas.mjs';
import { events, zoneOf, zones } from './joystick.mjs';

const left = 44, cell = 4, rows = zones.length + 2;  // points, the zones, the button

export class Strip {
    #moments = [];

    clear() {
        this.#moments = [];
    }

    /** Adds an agent step. Of the events that the console saw within it, the first in another zone is shown. */
    add({ event, seen, byHand, reward, lifeLost }) {
        const other = seen.find((frame) => zoneOf(frame) !== zoneOf(event));
        this.#moments.push({ event, other, byHand, reward, lifeLost });
        if (this.#moments.length > 600) this.#moments.splice(0, 200);
    }

    draw(canvas) {
        const { context, width, height } = prepare(canvas);
        const colours = palette();
        const row = height / rows;
        context.font = '12px system-ui, sans-serif';
        context.textBaseline = 'middle';
        const label = (text, number) => {
            context.fillStyle = colours.faint;
            context.fillText(text, 2, (number + 0.5) * row);
        };
        label('points', 0);
        zones.forEach((zone, number) => {
            label(zone.sign, number + 1);
            context.fillStyle = colours.zone;
            context.fillRect(left, (number + 1) * row + 1, width - left, row - 2);
        });
        label('fire', rows - 1);

        const shown = this.#moments.slice(-Math.floor((width - left) / cell));
        shown.forEach((moment, i) => {
            const x = left + i * cell;
            const fill = (number, colour) => {
                context.fillStyle = colour;
                context.fillRect(x, number * row + 1, cell - 0.5, row - 2);
            };
            if (moment.lifeLost) {
                context.globalAlpha = 0.35;
                context.fillStyle = colours.fire;
                context.fillRect(x, 0, cell - 0.5, height);
                context.globalAlpha = 1;
            }
            if (moment.reward) fill(0, moment.reward > 0 ? colours.reward : colours.fire);
            fill(zoneOf(moment.event) + 1, moment.byHand ? colours.person : colours.policy);
            if (moment.other !== undefined) fill(zoneOf(moment.other) + 1, colours.other);
            if (events[moment.event].fire) fill(rows - 1, colours.fire);
        });
    }
}
