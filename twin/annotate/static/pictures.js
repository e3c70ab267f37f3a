/* Pictures, kept in the page's memory alone: the server forbids the browser to store them. */

const MOST = 16;

export class Pictures {
  constructor() {
    this.kept = new Map();
  }

  /** A picture as a bitmap; rejects with the server's sentence where it is damaged. */
  get(camera, frame) {
    const key = `${camera}/${frame}`;
    const kept = this.kept.get(key);
    this.kept.delete(key);
    const picture = kept ?? load(camera, frame);
    this.kept.set(key, picture);
    // A picture that did not come is asked for again next time.
    picture.catch(() => this.kept.delete(key));
    if (this.kept.size > MOST) this.kept.delete(this.kept.keys().next().value);
    return picture;
  }
}

async function load(camera, frame) {
  const response = await fetch(`frame/${encodeURIComponent(camera)}/${frame}.jpg`, { credentials: "same-origin" });
  if (!response.ok) throw new Error((await response.json()).error);
  return createImageBitmap(await response.blob());
}
