// The joystick's events and zones, as cale/action.h and cale/zones.h number them.

/** Each event's direction (right and up are 1) and button. */
export const events = [
    ['NOOP', 0, 0, 0], ['FIRE', 0, 0, 1], ['UP', 0, 1, 0], ['RIGHT', 1, 0, 0], ['LEFT', -1, 0, 0], ['DOWN', 0, -1, 0],
    ['UPRIGHT', 1, 1, 0], ['UPLEFT', -1, 1, 0], ['DOWNRIGHT', 1, -1, 0], ['DOWNLEFT', -1, -1, 0],
    ['UPFIRE', 0, 1, 1], ['RIGHTFIRE', 1, 0, 1], ['LEFTFIRE', -1, 0, 1], ['DOWNFIRE', 0, -1, 1],
    ['UPRIGHTFIRE', 1, 1, 1], ['UPLEFTFIRE', -1, 1, 1], ['DOWNRIGHTFIRE', 1, -1, 1], ['DOWNLEFTFIRE', -1, -1, 1],
].map(([name, x, y, fire]) => ({ name, x, y, fire }));

/** The zones from the upper left to the lower right, as one looks at them. */
export const zones = [
    { x: -1, y: 1, sign: '↖' }, { x: 0, y: 1, sign: '↑' }, { x: 1, y: 1, sign: '↗' },
    { x: -1, y: 0, sign: '←' }, { x: 0, y: 0, sign: '·' }, { x: 1, y: 0, sign: '→' },
    { x: -1, y: -1, sign: '↙' }, { x: 0, y: -1, sign: '↓' }, { x: 1, y: -1, sign: '↘' },
];

/** Returns the number of the zone that an event needs the stick in. */
export function zoneOf(event) {
    const { x, y } = events[event];
    return (1 - y) * 3 + x + 1;
}

/** Returns where the joystick is in its unit disc. */
export function position({ radius, theta }) {
    return { x: radius * Math.cos(theta), y: radius * Math.sin(theta) };
}

/** Returns the action for a stick at (x, y), which is kept within its disc. */
export function actionAt(x, y, fire) {
    return { radius: Math.min(1, Math.hypot(x, y)), theta: Math.atan2(y, x), fire };
}
