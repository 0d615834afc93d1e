// Keeps a stream of server-sent events open, and says when it is not.

const SILENT_MS = 5000; // the server says something twice a second
const LOOK_MS = 1000;
const RETRY_MS = [500, 1000, 2000, 4000];

export class Live {
  /** handlers: by the name of an event; `opened` is called before the first one of each connection.
      onLink: called with whether the stream is there, and for how many seconds it has not been. */
  constructor(url, handlers, opened, onLink) {
    this.url = url;
    this.handlers = handlers;
    this.opened = opened;
    this.onLink = onLink;
    this.heardAt = performance.now();
    this.failures = 0;
    this.connect();
    setInterval(() => this.look(), LOOK_MS);
    document.addEventListener("visibilitychange", () => this.look());
  }

  connect() {
    const source = new EventSource(this.url);
    this.source = source;
    this.heardAt = Math.max(this.heardAt, performance.now() - SILENT_MS + 2 * LOOK_MS);
    source.onopen = () => this.opened();
    source.onerror = () => this.lost();
    for (const [name, handle] of Object.entries(this.handlers)) {
      source.addEventListener(name, (event) => {
        if (source !== this.source) return;
        this.heardAt = this.lastAt = performance.now();
        this.failures = 0;
        this.onLink(true, 0);
        handle(JSON.parse(event.data));
      });
    }
  }

  look() {
    if (this.source && performance.now() - this.heardAt > SILENT_MS) this.lost();
    if (!this.source) this.say();
  }

  say() {
    this.onLink(false, this.lastAt === undefined ? null : (performance.now() - this.lastAt) / 1000);
  }

  lost() {
    if (!this.source) return;
    this.source.close();
    this.source = null;
    this.say();
    const wait = RETRY_MS[Math.min(this.failures++, RETRY_MS.length - 1)];
    setTimeout(() => this.retry(), wait);
  }

  async retry() {
    // An EventSource does not tell why it failed; a token that is not valid any more cannot be waited for.
    const answer = await fetch("/", { method: "HEAD", cache: "no-store" }).catch(() => null);
    if (answer && answer.status === 401) location.reload();
    else this.connect();
  }
}
