// The page's copy of the volume, which follows the gateway's manifests. What is shown changes from one whole
// manifest to the next, except while a volume comes for the first time: then the overview is shown, and after
// it the volume as far as it is there.
import type { State } from "../state";
import { apply, norm, subtract } from "../view/geometry";
import { cameraOf } from "../view/look";
import type { Viewport } from "../view/viewport";
import type { Vec3 } from "../wire/messages";
import { allDone, fetchBlob, fetchEqual, Gone } from "./fetch";
import { GroupedVolume } from "./grouped_volume";
import type { Plane } from "./grouped_volume";
import { bytesPerVoxel, groupPlace, kGroupEdge, kGroupVoxels, newVoxels, parseManifest, voxelsOf } from "./manifest";
import type { Manifest, VolumeShape, Voxels } from "./manifest";
import { OverviewVoxels } from "./overview_voxels";

export const kBudgetMiB = 256;
const kRetryMs = 1000;
const kOverviewMs = 500; // while the overview alone is shown, it is taken up at most this often
const kRestartMs = 1000; // while a volume comes, newer manifests are taken up this often
const kPutMs = 200; // while a volume comes, the picture is drawn anew this often
// Before that, most groups come too soon for the overview's values to be worth the work.
const kFillAfterMs = 500;
const kFillMs = 8;
const kInterpolated = "?"; // in `placed`: the overview's values

class Restart extends Error {}

const isSame = (a: VolumeShape | undefined, b: VolumeShape) => JSON.stringify(a) === JSON.stringify(b);
const pause = (ms: number) => new Promise<void>((resolve) => setTimeout(resolve, ms));

// Indices are voxels of `shape`: of blocks of factor³ voxels if it is the overview.
export class VolumeCopy {
  groupsLeft = 0;
  groupsAll = 0;
  groupBytes = 0;
  fetching = { sinceMs: 0, groups: 0 }; // the running download: its start and its groups
  revision = 0;
  contentHash = ""; // palpated's; "": the copy is not whole, or is the overview
  isOverview = false;
  whyOverview = "";
  target: Viewport | null = null; // where the copy is drawn

  private front: GroupedVolume | null = null;
  // What each group of the front holds: a blob's name, "" for background.
  private placed: string[] = [];
  private readonly blobs = new Map<string, Voxels>();
  private shownName = "";
  private abort = new AbortController();
  private noMemory = { size: "", why: "" };
  private overviewBytes = 0;
  private wake = () => {};

  constructor(
    private readonly state: State,
    private readonly budgetMiB = kBudgetMiB,
  ) {
    state.on("manifest", () => this.wake());
    state.on("link", () => {
      if (state.link === "lost") this.abort.abort();
      this.wake();
    });
    void this.follow();
  }

  // Null: no volume yet.
  get shape(): VolumeShape | null {
    return this.front?.shape ?? null;
  }

  get factor(): number {
    return this.shape?.factor ?? 1;
  }

  // Background outside of the lattice.
  value(i: number, j: number, k: number): number {
    return this.front?.value(i, j, k) ?? 0;
  }

  plane(axis: 0 | 1 | 2, index: number): Plane {
    return this.front?.plane(axis, index) ?? { width: 0, height: 0, values: new Float32Array(0) };
  }

  // Of voxels, here and on the graphics card.
  get memoryBytes(): number {
    let bytes = this.overviewBytes + (this.target?.bytes ?? 0);
    for (const voxels of this.blobs.values()) bytes += voxels.byteLength;
    return bytes;
  }

  private async follow(): Promise<never> {
    for (;;) {
      const newest = this.state.manifest?.name ?? "";
      try {
        this.abort = new AbortController();
        if (newest !== "" && newest !== this.shownName) await this.take(newest);
        if (newest === (this.state.manifest?.name ?? "")) await this.woken(Infinity);
      } catch (error) {
        if (error instanceof Restart) continue;
        if (!(error instanceof Gone)) console.warn("palpate: volume:", error);
        if (newest === this.state.manifest?.name) await this.woken(this.state.link === "lost" ? Infinity : kRetryMs);
      }
    }
  }

  // Resolves at the next message about the volume or the link.
  private woken(mostMs: number): Promise<void> {
    return new Promise((resolve) => {
      this.wake = resolve;
      if (mostMs < Infinity) setTimeout(resolve, mostMs);
    });
  }

  private async take(name: string): Promise<void> {
    const manifest = parseManifest(name, await (await fetchBlob(name, this.abort.signal)).text());
    this.forgetBlobs(new Set([...(manifest.groups ?? []), ...this.placed]));
    this.whyOverview = this.problem(manifest);
    if (this.whyOverview !== "") {
      await this.showOverview(await this.fetchOverview(manifest));
      this.placed = [];
      this.shown(manifest);
      return pause(kOverviewMs);
    }
    const isSameShape = isSame(this.front?.shape, manifest.shape);
    const isSameSize = this.front?.shape.size.join() === manifest.shape.size.join();
    if (this.isOverview || !isSameSize || (this.front?.overview && !isSameShape)) {
      const overview = await this.fetchOverview(manifest);
      await this.showOverview(overview);
      this.front = this.beginWhole(manifest, overview);
    }
    const front = this.front!;
    if (front.overview) {
      await allDone([this.fetchGroups(manifest), this.fillIn(front)]);
    } else {
      await this.fetchGroups(manifest);
      if (!isSameShape) this.front = this.beginWhole(manifest, null);
    }
    this.showWhole(manifest);
  }

  private forgetBlobs(but: Set<string>): void {
    for (const name of this.blobs.keys()) if (!but.has(name)) this.blobs.delete(name);
  }

  // Why only the overview is shown.
  private problem({ shape, groups }: Manifest): string {
    if (!groups) return "the gateway gives the overview alone";
    if (this.noMemory.size === shape.size.join()) return this.noMemory.why;
    if (this.target) return this.target.problem(shape, this.budgetMiB);
    const bytes = shape.size[0] * shape.size[1] * shape.size[2] * bytesPerVoxel(shape.type);
    return bytes <= this.budgetMiB * 2 ** 20 ? "" : `the volume needs more than ${this.budgetMiB} MiB`;
  }

  private async fetchOverview({ shape, overview: { name, size, factor } }: Manifest): Promise<OverviewVoxels> {
    const bytes = await (await fetchBlob(name, this.abort.signal)).arrayBuffer();
    this.overviewBytes = bytes.byteLength;
    return new OverviewVoxels({ ...shape, size, factor }, voxelsOf(shape.type, bytes, size[0] * size[1] * size[2]));
  }

  private async showOverview({ shape, blocks }: OverviewVoxels): Promise<void> {
    await this.target?.glance(shape, blocks);
    const isNew = !this.isOverview || !isSame(this.front?.shape, shape);
    if (isNew) this.target?.prepare(shape);
    const front = GroupedVolume.fromDense(shape, blocks);
    this.front = front;
    this.isOverview = true;
    this.contentHash = "";
    for (const [number, voxels] of front.groups) this.target?.putGroup(...groupPlace(front.counts, number), voxels);
    if (isNew) this.target?.present();
    this.state.emit("picture");
  }

  // With an overview, this stands for the groups that are not there.
  private beginWhole(manifest: Manifest, overview: OverviewVoxels | null): GroupedVolume {
    const front = new GroupedVolume(manifest.shape);
    front.overview = overview;
    try {
      this.target?.prepare(manifest.shape);
    } catch (error) {
      this.noMemory = { size: manifest.shape.size.join(), why: String(error) };
      throw new Restart("no memory");
    }
    this.placed = manifest.groups!.map(() => "");
    this.isOverview = false;
    return front;
  }

  // Fetches the groups that are not here, each blob once.
  private async fetchGroups(manifest: Manifest): Promise<void> {
    const comesFirst = this.front!.overview !== null;
    const numbers = new Map<string, number[]>();
    manifest.groups!.forEach((name, number) => {
      if (name === "" || this.blobs.has(name)) return;
      if (comesFirst) this.front!.awaited.add(number);
      const same = numbers.get(name);
      if (same) same.push(number);
      else numbers.set(name, [number]);
    });
    this.groupsAll = manifest.groups!.filter((name) => name !== "").length;
    this.groupsLeft = [...numbers.values()].flat().length;
    const names = [...numbers.keys()];
    if (comesFirst) this.sortByDistance(names, numbers);
    const begun = performance.now();
    this.fetching = { sinceMs: begun, groups: this.groupsLeft };
    let put = begun;
    let arrived: string[] = [];
    const putArrived = () => {
      for (const name of arrived) for (const number of numbers.get(name)!) this.place(number, name);
      arrived = [];
      put = performance.now();
      this.state.emit("picture");
    };
    this.groupBytes = kGroupVoxels * bytesPerVoxel(manifest.shape.type);
    await fetchEqual(names, this.groupBytes, this.abort.signal, (some, blobs) => {
      some.forEach((name, n) => {
        this.blobs.set(name, voxelsOf(manifest.shape.type, blobs[n], kGroupVoxels));
        this.groupsLeft -= numbers.get(name)!.length;
      });
      this.state.emit("copyProgress");
      if (!comesFirst) return;
      arrived.push(...some);
      const now = performance.now();
      if (now - put > kPutMs) putArrived();
      if (now - begun > kRestartMs && this.state.manifest && this.state.manifest.name !== manifest.name) {
        throw new Restart("a newer manifest");
      }
    }).finally(() => comesFirst && putArrived());
  }

  private sortByDistance(names: string[], numbers: Map<string, number[]>): void {
    const { counts } = this.front!;
    const map = this.state.placement?.deviceFromIndex;
    const eye = cameraOf(this.state).eye();
    if (!map) return;
    const distances = new Map<string, number>();
    for (const [name, [first]] of numbers) {
      const middle = groupPlace(counts, first).map((n) => (n + 0.5) * kGroupEdge) as Vec3;
      distances.set(name, norm(subtract(apply(map, middle), eye)));
    }
    names.sort((a, b) => distances.get(a)! - distances.get(b)!);
  }

  // Draws the overview's values for the groups that are not there, the last ones first; then the volume is shown.
  private async fillIn(front: GroupedVolume): Promise<void> {
    if (this.target) {
      for (let waited = 0; waited < kFillAfterMs && front.awaited.size > 0; waited += kFillMs) await pause(kFillMs);
      let begun = performance.now();
      for (const number of [...front.awaited].reverse()) {
        if (!front.awaited.has(number) || this.placed[number] !== "") continue;
        const place = groupPlace(front.counts, number);
        this.target.putGroup(...place, front.overview!.group(front.shape, place));
        this.placed[number] = kInterpolated;
        if (performance.now() - begun < kFillMs) continue;
        await pause(0);
        begun = performance.now();
      }
      this.target.present();
    }
    this.state.emit("picture");
  }

  private place(number: number, name: string): void {
    const front = this.front!;
    if (this.placed[number] === name) return;
    const voxels = this.blobs.get(name) ?? newVoxels(front.shape.type, kGroupVoxels).fill(front.shape.background);
    if (name === "") front.groups.delete(number);
    else front.groups.set(number, voxels);
    front.awaited.delete(number);
    this.placed[number] = name;
    this.target?.putGroup(...groupPlace(front.counts, number), voxels);
  }

  private showWhole(manifest: Manifest): void {
    const front = this.front!;
    manifest.groups!.forEach((name, number) => this.place(number, name));
    front.awaited.clear();
    front.overview = null;
    this.overviewBytes = 0;
    this.target?.present();
    this.forgetBlobs(new Set(manifest.groups));
    this.contentHash = manifest.contentHash;
    this.shown(manifest);
  }

  private shown(manifest: Manifest): void {
    this.groupsLeft = 0;
    this.revision = manifest.revision;
    this.shownName = manifest.name;
    this.state.emit("copyProgress");
    this.state.emit("picture");
    this.state.emit("copyShown");
  }
}
