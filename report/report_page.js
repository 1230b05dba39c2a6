// Makes a report answer to its reader: values of curves under the pointer, groups switched off, games filtered.
// Without it the page is complete; all that it adds to see is made here.
(() => {
    const svgs = [...document.querySelectorAll('.card svg')];
    const groups = [...document.querySelectorAll('#groups option')].map((option) => ({
        label: option.textContent, colour: option.dataset.colour, shown: true,
    }));
    let wanted = '';  // part of a game's name

    const make = (name, properties, ...children) => {
        const element = Object.assign(document.createElement(name), properties);
        element.append(...children);
        return element;
    };
    const isWanted = (game) => !game || game.toLowerCase().includes(wanted);

    // Groups ------------------------------------------------------------------------------

    function showGroups() {
        for (const element of document.querySelectorAll('[data-series]'))
            element.classList.toggle('hidden', !groups[element.dataset.series].shown);
    }

    function groupButton(group) {
        const swatch = make('i', {});
        swatch.style.background = group.colour;
        const button = make('button', { type: 'button', title: 'hide or show' }, swatch, group.label);
        button.setAttribute('aria-pressed', 'true');
        button.addEventListener('click', () => {
            group.shown = !group.shown;
            button.setAttribute('aria-pressed', String(group.shown));
            showGroups();
        });
        return button;
    }

    // Games -------------------------------------------------------------------------------

    /** The panels of the games that are wanted close ranks; what stands below them moves up. */
    function showPanels(svg) {
        const places = svg.dataset.panels.split(';').map((text) => {
            const [game, left, top] = text.split(',');
            return { game, left: Number(left), top: Number(top) };
        });
        const shown = places.filter(({ game }) => isWanted(game));
        const rows = [...new Set(places.map(({ top }) => top))];
        const used = new Set(shown.map((_, i) => places[i].top)).size;
        const saved = rows.length > 1 ? (rows.length - Math.max(1, used)) * (rows[1] - rows[0]) : 0;
        const below = rows[rows.length - 1] + 1;
        for (const element of svg.querySelectorAll(':scope > :not(title)')) {
            const panel = places[element.dataset.panel];
            if (panel) {
                const place = shown.indexOf(panel);
                element.style.display = place < 0 ? 'none' : '';
                const to = places[Math.max(0, place)];
                element.setAttribute('transform', `translate(${to.left - panel.left} ${to.top - panel.top})`);
            } else if (element.tagName === 'text' && Number(element.getAttribute('y')) > below) {
                element.setAttribute('transform', `translate(0 ${-saved})`);
            }
        }
        const { width, height } = svg.querySelector('rect').getBBox();
        svg.setAttribute('viewBox', `0 0 ${width} ${height - saved}`);
        svg.setAttribute('height', height - saved);
    }

    function showGames() {
        for (const svg of svgs) if (svg.dataset.panels) showPanels(svg);
        const table = document.querySelector('#game_scores ~ .card table');
        for (const row of table?.tBodies[0].rows ?? [])
            row.classList.toggle('hidden', !isWanted(row.cells[0].textContent));
    }

    // Values ------------------------------------------------------------------------------

    const value = make('div', { className: 'value', hidden: true });
    const marks = new Map(svgs.map((svg) => {
        const mark = document.createElementNS(svg.namespaceURI, 'circle');
        mark.setAttribute('r', '5');
        mark.setAttribute('fill', 'none');
        mark.setAttribute('stroke-width', '2');
        return [svg, mark];
    }));
    const text = (number) => Number(number).toLocaleString('en', { maximumSignificantDigits: 5 });

    function curvesOf(svg) {
        return [...svg.querySelectorAll('polyline[data-samples]')].map((line) => ({
            line,
            series: groups[line.dataset.series],
            game: svg.dataset.panels?.split(';')[line.dataset.panel]?.split(',')[0] ?? '',
            points: line.getAttribute('points').split(' ').map((point) => point.split(',').map(Number)),
            samples: line.dataset.samples.split(' ').map((sample) => sample.split(',')),
        }));
    }

    /** The nearest point of a curve that can be seen, within 30 pixels. */
    function nearest(curves, svg, event) {
        let best = { distance: 30 };
        for (const curve of curves) {
            if (curve.line.style.display === 'none' || curve.line.classList.contains('hidden')) continue;
            const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(curve.line.getScreenCTM().inverse());
            curve.points.forEach(([x, y], i) => {
                const distance = Math.hypot(x - at.x, y - at.y);
                if (distance < best.distance) best = { distance, curve, i };
            });
        }
        return best.curve ? best : null;
    }

    function hover(svg) {
        const curves = curvesOf(svg);
        if (curves.length === 0) return;
        const mark = marks.get(svg);
        const leave = () => {
            value.hidden = true;
            mark.remove();
        };
        svg.addEventListener('pointerleave', leave);
        svg.addEventListener('pointermove', (event) => {
            const found = nearest(curves, svg, event);
            if (!found) return leave();
            const { curve, i } = found;
            const [x, y, low, high] = curve.samples[i];
            const interval = low === y && high === y ? '' : ` [${text(low)}, ${text(high)}]`;
            const game = curve.game ? `${curve.game}, ` : '';
            value.textContent = `${game}${curve.series.label}\nat ${text(x)}: ${text(y)}${interval}`;
            value.hidden = false;
            const left = Math.min(event.clientX + 16, document.documentElement.clientWidth - value.offsetWidth - 8);
            value.style.left = `${Math.max(8, left)}px`;
            value.style.top = `${Math.max(8, event.clientY - value.offsetHeight - 12)}px`;
            mark.setAttribute('cx', curve.points[i][0]);
            mark.setAttribute('cy', curve.points[i][1]);
            mark.setAttribute('stroke', curve.series.colour);
            mark.setAttribute('transform', curve.line.getAttribute('transform') ?? '');
            svg.append(mark);
        });
    }

    // The page ----------------------------------------------------------------------------

    const filter = make('input', { type: 'search', placeholder: 'filter games' });
    filter.setAttribute('aria-label', 'Show only games whose names hold this');
    filter.addEventListener('input', () => {
        wanted = filter.value.trim().toLowerCase();
        showGames();
    });
    const tools = make('div', { className: 'tools' }, ...groups.map(groupButton), filter);
    tools.setAttribute('role', 'toolbar');
    tools.setAttribute('aria-label', 'Groups and games');
    document.querySelector('nav').after(tools);
    document.body.append(value);
    svgs.forEach(hover);
})();
