// As much of YAML as task files are written in: blocks, lists, texts and numbers; anything else is refused.

/** A text that is not understood; the message says where. */
export class YamlError extends Error {}

/** @typedef {{indent: number, text: string, number: number}} Line */

/** Read a document of plain data. @param {string} text @returns {any} */
export function parseYaml(text) {
    if (text.trimStart().startsWith("{")) return new Flow(text.trim(), 1).whole();
    /** @type {Line[]} */
    const lines = [];
    text.split(/\r?\n/).forEach((raw, k) => {
        const line = uncommented(raw).trimEnd(), body = line.trimStart();
        if (!body || body === "---" || body === "...") return;
        if (/^\s*\t/.test(line)) throw new YamlError(`line ${k + 1}: expected spaces, got a tab`);
        const last = lines[lines.length - 1];
        if (last && open(last.text)) last.text += ` ${body}`; // a flow list or mapping that goes on
        else lines.push({ indent: line.length - body.length, text: body, number: k + 1 });
    });
    if (!lines.length) return null;
    const reader = { lines, at: 0 };
    const found = block(reader, lines[0].indent);
    if (reader.at < lines.length) throw new YamlError(`line ${lines[reader.at].number}: it is indented otherwise than what is before it`);
    return found;
}

/** A line without its comment. @param {string} line */
function uncommented(line) {
    let quote = "";
    for (let k = 0; k < line.length; ++k) {
        const c = line[k];
        if (quote) quote = c === quote && line[k - 1] !== "\\" ? "" : quote;
        else if ((c === '"' || c === "'") && /(^|[\s[{,:])$/.test(line.slice(0, k))) quote = c;
        else if (c === "#" && (k === 0 || /\s/.test(line[k - 1]))) return line.slice(0, k);
    }
    return line;
}

/** Whether brackets are still open. @param {string} text */
function open(text) {
    const bare = text.replace(/"(\\.|[^"\\])*"|'(?:''|[^'])*'/g, "");
    return (bare.match(/[[{]/g) ?? []).length > (bare.match(/[\]}]/g) ?? []).length;
}

/** @param {{lines: Line[], at: number}} reader @param {number} indent @returns {any} */
function block(reader, indent) {
    const { text, number } = reader.lines[reader.at];
    if (text === "-" || text.startsWith("- ")) return list(reader, indent);
    if (keyed(text)) return mapping(reader, indent);
    reader.at += 1;
    return scalar(text, number);
}

/** @param {{lines: Line[], at: number}} reader @param {number} indent */
function list(reader, indent) {
    const found = [];
    for (let line = reader.lines[reader.at]; line && line.indent === indent && /^-( |$)/.test(line.text); line = reader.lines[reader.at]) {
        const rest = line.text.slice(1).trimStart();
        if (rest) {
            reader.lines[reader.at] = { ...line, indent: indent + line.text.length - rest.length, text: rest };
            found.push(block(reader, indent + line.text.length - rest.length));
        } else found.push(below(reader, indent));
    }
    return found;
}

/** @param {{lines: Line[], at: number}} reader @param {number} indent */
function mapping(reader, indent) {
    /** @type {Record<string, any>} */
    const found = {};
    for (let line = reader.lines[reader.at]; line && line.indent === indent; line = reader.lines[reader.at]) {
        const parts = keyed(line.text);
        if (!parts) break;
        const [key, rest] = parts;
        if (Object.hasOwn(found, key)) throw new YamlError(`line ${line.number}: ${key} is there twice`);
        if (rest) {
            reader.at += 1;
            found[key] = scalar(rest, line.number);
        } else found[key] = below(reader, indent);
    }
    return found;
}

/** What belongs to the line before; null for nothing. @param {{lines: Line[], at: number}} reader @param {number} indent */
function below(reader, indent) {
    reader.at += 1;
    const next = reader.lines[reader.at];
    if (!next || next.indent < indent || (next.indent === indent && !/^-( |$)/.test(next.text))) return null;
    return block(reader, next.indent);
}

/** A key and what is behind it. @param {string} text */
function keyed(text) {
    const found = /^("(?:\\.|[^"\\])*"|'(?:''|[^'])*'|[^\s"'[\]{},&*!|>%@`#-][^:]*?)\s*:(?:\s+(.*))?$/.exec(text);
    return found ? [String(plain(found[1])), found[2] ?? ""] : null;
}

/** @param {string} text @param {number} line */
function scalar(text, line) {
    if (/^[&*!|>%@`]/.test(text)) throw new YamlError(`line ${line}: ${text.slice(0, 12)}: this page reads no anchors, tags or blocks of text`);
    return /^[[{]/.test(text) ? new Flow(text, line).whole() : plain(text);
}

/** @param {string} text @returns {string | number | boolean | null} */
function plain(text) {
    if (text.startsWith('"')) return JSON.parse(text);
    if (text.startsWith("'")) return text.slice(1, -1).replaceAll("''", "'");
    if (/^(true|false)$/i.test(text)) return text.toLowerCase() === "true";
    if (/^(null|~|)$/i.test(text)) return null;
    return /^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$/.test(text) ? Number(text) : text;
}

/** A list or mapping in brackets. */
class Flow {
    /** @param {string} text @param {number} line */
    constructor(text, line) {
        this.text = text;
        this.line = line;
        this.at = 0;
    }

    /** @returns {never} */
    fail() {
        throw new YamlError(`line ${this.line}: not understood from “${this.text.slice(this.at, this.at + 20)}”`);
    }

    space() {
        while (/\s/.test(this.text[this.at] ?? "")) this.at += 1;
    }

    /** @param {string} c */
    take(c) {
        this.space();
        if (this.text[this.at] !== c) return false;
        this.at += 1;
        return true;
    }

    whole() {
        const found = this.value();
        this.space();
        return this.at < this.text.length ? this.fail() : found;
    }

    /** @returns {any} */
    value() {
        if (this.take("[")) return this.several("]", () => this.value(), (/** @type {any[]} */ items) => items);
        if (this.take("{")) return this.several("}", () => this.pair(), Object.fromEntries);
        return plain(this.word(/^("(?:\\.|[^"\\])*"|'(?:''|[^'])*'|[^,[\]{}]*)/));
    }

    pair() {
        const key = plain(this.word(/^("(?:\\.|[^"\\])*"|'(?:''|[^'])*'|[^,:[\]{}]*)/));
        if (!this.take(":")) this.fail();
        return [String(key), this.value()];
    }

    /** @template T @param {string} end @param {() => T} item @param {(items: T[]) => any} made */
    several(end, item, made) {
        /** @type {T[]} */
        const items = [];
        while (!this.take(end)) {
            items.push(item());
            if (!this.take(",") && this.text[this.at] !== end) this.fail();
        }
        return made(items);
    }

    /** @param {RegExp} form */
    word(form) {
        this.space();
        const found = form.exec(this.text.slice(this.at));
        if (!found || (!found[0] && !/[,\]}]/.test(this.text[this.at] ?? ""))) this.fail();
        this.at += found[0].length;
        return found[0].trim();
    }
}
