// Elements, made in a line.

/**
 * An element with properties and children.
 * @template {keyof HTMLElementTagNameMap} K
 * @param {K} tag
 * @param {Record<string, unknown>} [properties] of the element; names with a hyphen are attributes
 * @param {...(Node | string)} children
 * @returns {HTMLElementTagNameMap[K]}
 */
export function make(tag, properties = {}, ...children) {
    const element = document.createElement(tag);
    for (const [name, value] of Object.entries(properties)) {
        if (name.includes("-") || name === "role") element.setAttribute(name, String(value));
        else Object.assign(element, { [name]: value });
    }
    element.append(...children);
    return element;
}

/** Set a text only where it differs. @param {Node} element @param {string} text */
export function write(element, text) {
    if (element.textContent !== text) element.textContent = text;
}

/** Mark a field while what stands in it is refused. @param {HTMLElement} field @param {boolean} refused */
export function mark(field, refused) {
    if (refused) field.setAttribute("aria-invalid", "true");
    else field.removeAttribute("aria-invalid");
}

/** Fill a list of choices, if it is another one. @param {HTMLSelectElement} select @param {[string, string][]} choices values and texts @param {string} value */
export function choose(select, choices, value) {
    const now = [...select.options].map((option) => `${option.value}\n${option.text}`).join("\n\n");
    const then = choices.map(([key, text]) => `${key}\n${text}`).join("\n\n");
    if (now !== then) select.replaceChildren(...choices.map(([key, text]) => make("option", { value: key }, text)));
    if (select.value !== value) select.value = value;
}
