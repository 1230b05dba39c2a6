// The dial: the stick in its disc, the nine zones at the threshold, where the policy would hold the stick, the button.
import { palette, prepare } from './canvas.mjs';
import { events, position, zoneOf, zones } from './joystick.mjs';

const meterWidth = 26;

/** Returns the disc's centre and radius, and the meter of the button beside it. */
function layout(width, height) {
    const radius = Math.max(20, Math.min((width - meterWidth - 44) / 2, height / 2 - 14));
    const left = (width - 2 * radius - meterWidth - 24) / 2;
    return { x: left + radius, y: height / 2, radius, meter: left + 2 * radius + 24 };
}

/** Returns where a pointer at (x, y) of the canvas holds the stick: at the rim where it points outside. */
export function stickAt(canvas, x, y) {
    const dial = layout(canvas.clientWidth, canvas.clientHeight);
    const across = (x - dial.x) / dial.radius, up = (dial.y - y) / dial.radius;
    const beyond = Math.max(1, Math.hypot(across, up));
    return { x: across / beyond, y: up / beyond };
}

/** The part of a zone from its left to its right edge, or from bottom to top. */
function extent(direction, [lower, upper]) {
    return [[-1, lower], [lower, upper], [upper, 1]][direction + 1];
}

/**
 * Draws the dial.
 * @param view {threshold, edges, paddle, commanded, stick, event, byHand, draws, values, valueText}: `edges`, of the
 *     centre zone on either axis; `paddle`, whether the action places one, and only x and fire count; `stick` is where
 *     a moving one is; `draws` (x, y, fire) are of a policy's Gaussian; `values`, by event, of a policy that chooses
 *     among them.
 */
export function drawDial(canvas, view) {
    const { context, width, height } = prepare(canvas);
    const dial = layout(width, height);
    const pen = {
        context, colours: palette(), dial,
        at: (x, y) => [dial.x + dial.radius * x, dial.y - dial.radius * y],
        circle: (x, y, radius) => {
            context.beginPath();
            context.arc(x, y, radius, 0, 2 * Math.PI);
        },
    };
    const shades = view.values ? shadesOf(view.values) : null;
    context.save();
    pen.circle(dial.x, dial.y, dial.radius);
    context.clip();
    context.fillStyle = pen.colours.zone;
    context.fill();
    if (!view.paddle) drawZones(pen, view, shades);
    drawThresholds(pen, view);
    if (view.draws) drawDraws(pen, view.draws);
    context.restore();
    context.strokeStyle = pen.colours.line;
    context.lineWidth = 1.5;
    pen.circle(dial.x, dial.y, dial.radius);
    context.stroke();
    if (shades && !view.paddle) writeValues(pen, view, shades);
    drawMeter(pen, view, shades);
    drawStick(pen, view);
}

/** The zones by their values, and the one that counts now: by its colour, or where values have that by its edge. */
function drawZones({ context, colours, dial, at }, view, shades) {
    const current = zoneOf(view.event);
    const rectangle = (number, inset) => {
        const zone = zones[number];
        const [left, right] = extent(zone.x, view.edges), [bottom, top] = extent(zone.y, view.edges);
        const [x, y] = at(left, top);
        return [x + inset, y + inset, dial.radius * (right - left) - 2 * inset, dial.radius * (top - bottom) - 2 * inset];
    };
    if (shades) {
        context.fillStyle = colours.reward;
        zones.forEach((_, number) => {
            context.globalAlpha = 0.75 * shades.zones[number];
            context.fillRect(...rectangle(number, 0));
        });
        context.globalAlpha = 1;
        context.strokeStyle = view.byHand ? colours.person : colours.policy;
        context.lineWidth = 4;
        context.strokeRect(...rectangle(current, 3));
    } else {
        context.globalAlpha = 0.25;
        context.fillStyle = view.byHand ? colours.person : colours.policy;
        context.fillRect(...rectangle(current, 0));
        context.globalAlpha = 1;
    }
}

/** The lines beyond which the stick counts; of a paddle its way. */
function drawThresholds({ context, colours, at }, view) {
    context.strokeStyle = colours.paper;
    context.lineWidth = 2;
    context.beginPath();
    const line = (from, to) => {
        context.moveTo(...at(...from));
        context.lineTo(...at(...to));
    };
    if (view.paddle) line([-1, 0], [1, 0]);
    for (const side of view.paddle ? [] : view.edges) {
        line([side, -1], [side, 1]);
        line([-1, side], [1, side]);
    }
    context.stroke();
}

function drawDraws({ context, colours, at, circle }, draws) {
    context.fillStyle = colours.reward;
    context.globalAlpha = 0.28;
    for (let i = 0; i < draws.length; i += 3) {
        circle(...at(draws[i], draws[i + 1]), 2);
        context.fill();
    }
    context.globalAlpha = 1;
}

/** The stick; where it moves by itself, a ring is where it is told to be. */
function drawStick({ context, colours, at, circle }, view) {
    const target = position(view.commanded);
    const stick = view.stick ?? target;
    const colour = view.byHand ? colours.person : colours.policy;
    if (view.stick) {
        context.strokeStyle = colours.strong;
        context.lineWidth = 2;
        circle(...at(target.x, target.y), 9);
        context.stroke();
    }
    context.strokeStyle = colour;
    context.lineWidth = 4;
    context.lineCap = 'round';
    context.beginPath();
    context.moveTo(...at(0, 0));
    context.lineTo(...at(stick.x, stick.y));
    context.stroke();
    context.fillStyle = colour;
    circle(...at(stick.x, stick.y), 10);
    context.fill();
    context.strokeStyle = colours.paper;
    context.lineWidth = 2;
    context.stroke();
}

/** The button: how far it is pressed, the threshold, and what the policy would do with it. */
function drawMeter({ context, colours, dial }, view, shades) {
    const left = dial.meter, bottom = dial.y + dial.radius, height = 2 * dial.radius;
    const pressed = view.stick ? view.stick.button : view.commanded.fire;
    context.fillStyle = colours.zone;
    context.fillRect(left, bottom - height, meterWidth, height);
    context.fillStyle = colours.fire;
    context.fillRect(left, bottom - height * pressed, meterWidth, height * pressed);
    context.fillStyle = colours.reward;
    if (view.draws) {
        context.globalAlpha = 0.2;
        for (let i = 2; i < view.draws.length; i += 12)
            context.fillRect(left + meterWidth + 2, bottom - height * view.draws[i] - 1, 8, 2);
    } else if (shades) {
        const mark = bottom - height * view.threshold;
        for (const [fire, top, end] of [[0, mark, bottom], [1, bottom - height, mark]]) {
            context.globalAlpha = 0.15 + 0.85 * shades.fire[fire];
            context.fillRect(left + meterWidth + 3, top + 1, 6, end - top - 2);
        }
    }
    context.globalAlpha = 1;
    context.strokeStyle = colours.strong;
    context.lineWidth = 1;
    const mark = Math.round(bottom - height * view.threshold) + 0.5;
    context.beginPath();
    context.moveTo(left - 4, mark);
    context.lineTo(left + meterWidth + 4, mark);
    context.stroke();
    context.strokeStyle = colours.line;
    context.strokeRect(left, bottom - height, meterWidth, height);
}

/** Returns, from 0 to 1, how good each zone and the button's two states are at their best. */
function shadesOf(values) {
    const best = zones.map(() => -Infinity), fire = [-Infinity, -Infinity];
    values.forEach((value, event) => {
        if (Number.isNaN(value)) return;
        best[zoneOf(event)] = Math.max(best[zoneOf(event)], value);
        fire[events[event].fire] = Math.max(fire[events[event].fire], value);
    });
    const known = best.filter(Number.isFinite);
    const low = Math.min(...known), span = Math.max(...known) - low || 1;
    const shade = (value) => (Number.isFinite(value) ? Math.max(0, (value - low) / span) ** 2 : 0);
    return { best, zones: best.map(shade), fire: fire.map(shade) };
}

function writeValues({ context, colours, at }, view, { best }) {
    context.fillStyle = colours.strong;
    context.font = '11px system-ui, sans-serif';
    context.textAlign = 'center';
    context.textBaseline = 'middle';
    const away = (1 + view.threshold) / 2;
    zones.forEach((zone, number) => {
        if (!Number.isFinite(best[number])) return;
        const diagonal = zone.x && zone.y;
        const reach = diagonal ? Math.min(0.66, away) : away * 0.97;
        if (diagonal && view.threshold > 0.6) return;  // too small for a number
        context.fillText(view.valueText(best[number]), ...at(zone.x * reach, zone.y * reach + (diagonal || zone.y ? 0 : 0.16)));
    });
}
