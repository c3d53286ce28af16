// The contract's messages (palpate/v1/*.proto, whose comments explain the fields) as the page has them: vectors and
// maps are arrays, counts are numbers. The gateway sends each in an Envelope, without what guests may not see.
import { fromBinary } from "@bufbuild/protobuf";
import type { Message } from "@bufbuild/protobuf";
import { EnvelopeSchema } from "../contract/palpate/v1/envelope_pb";
import type { Facts } from "../contract/palpate/v1/facts_pb";
import type { AffineMap as AffineMapMessage, Quaternion, Vector3 } from "../contract/palpate/v1/geometry_pb";
import type { PoseSample } from "../contract/palpate/v1/pose_pb";
import { FreeSide } from "../contract/palpate/v1/render_pb";
import { VoxelType as VoxelTypes } from "../contract/palpate/v1/voxel_type_pb";
import type { AffineMap } from "../view/geometry";
import type { Vec3, VoxelType } from "./messages";

// prettier-ignore
export type Plain<T> =
  T extends Vector3 ? Vec3
  : T extends Quaternion ? [number, number, number, number] // x, y, z, w
  : T extends AffineMapMessage ? AffineMap
  : T extends bigint ? number
  : T extends (infer E)[] ? Plain<E>[]
  : T extends Message ? { [K in keyof T as K extends "$typeName" | "$unknown" ? never : K]: Plain<T[K]> }
  : T;
// Messages that are always there.
type Whole<T, K extends keyof T> = T & { [P in K]-?: NonNullable<T[P]> };

// Lengths in mm of D (x right, y up, z to the user), forces in N, values in data units.
type WholeSample = Whole<Plain<PoseSample>, "hipMm" | "scpHMm" | "stylusOrientation" | "forceN" | "forces">;
export type Sample = Omit<WholeSample, "touchingBalls"> & { touchingBalls: bigint }; // a number has 53 bits
export interface Sent {
  sequence: number;
  sentMs: number; // the gateway's monotonic clock
  ageMs: number; // at sentMs; NaN if palpated is on another machine
  fresh: boolean; // the gateway hears from palpated
}
export type Pose = Sample & Sent;

type PlainFacts = Plain<Facts>;
type Known<K extends keyof PlainFacts> = NonNullable<PlainFacts[K]>;
export type Volume = Whole<Known<"volume">, "worldFromIndex"> & { size: Vec3; type: VoxelType };
export type Placement = Whole<Known<"placement">, "deviceFromIndex">;
export type SuggestedIsovalue = Volume["suggestedIsovalues"][number];

// The facts that the page has, one of them in each message.
export interface GuestFacts {
  volume: Volume;
  placement: Placement;
  settings: Whole<Known<"settings">, "settings">;
  series: Known<"series">; // no frames: no series
  recording: Known<"recording">;
}
export const kFacts = ["volume", "placement", "settings", "series", "recording"] as const;

function plain(value: unknown): unknown {
  if (typeof value === "bigint") return Number(value);
  if (Array.isArray(value)) return value.map(plain);
  if (typeof value !== "object" || value === null || !("$typeName" in value)) return value;
  const { $typeName, $unknown, ...rest } = value as { $typeName: string; $unknown?: unknown };
  const fields = Object.fromEntries(Object.entries(rest).map(([name, field]) => [name, plain(field)]));
  switch ($typeName) {
    case "palpate.v1.Vector3":
      return [fields.x, fields.y, fields.z];
    case "palpate.v1.Quaternion":
      return [fields.x, fields.y, fields.z, fields.w];
    case "palpate.v1.AffineMap": {
      const { linear, translation } = fields as { linear: number[]; translation?: Vec3 };
      return [0, 1, 2].flatMap((row) => [...linear.slice(3 * row, 3 * row + 3), translation?.[row] ?? 0]);
    }
  }
  return fields;
}

// A setting's name in palpate/v1 as protobuf writes it here: "stiffness_n_per_mm" is stiffnessNPerMm.
export function memberOf(key: string): string {
  return key.replace(/_(.)/g, (_, letter: string) => letter.toUpperCase());
}

export function isFreeAbove(pose: Pose | null): boolean {
  return pose?.freeSide === FreeSide.ABOVE;
}

// What an enumerator is called in words.ts: that has the order of the numbers.
export function nameOf<Names extends { unknown: string }>(names: Names, number: number): keyof Names {
  return (Object.keys(names) as (keyof Names)[])[number] ?? "unknown";
}

// A volume is null while there is none.
export type NewFact = Partial<{ [F in keyof GuestFacts]: GuestFacts[F] | null }>;
export type Received = { pose: Pose } | { fact: NewFact };

// Null: no message that this page knows.
export function decode(bytes: ArrayBuffer): Received | null {
  try {
    const { what, ...envelope } = fromBinary(EnvelopeSchema, new Uint8Array(bytes));
    if (what.case === "pose") {
      const sample = plain(what.value) as Plain<PoseSample>;
      if (!sample.hipMm || !sample.scpHMm || !sample.stylusOrientation || !sample.forceN || !sample.forces) return null;
      const { sequence, sentMs, ageMs = NaN, fresh } = envelope;
      const { touchingBalls } = what.value;
      return { pose: { ...(sample as WholeSample), touchingBalls, sequence, sentMs, ageMs, fresh } };
    }
    if (what.case !== "facts") return null;
    const fact = plain(what.value) as PlainFacts;
    const { volume, placement, settings } = fact;
    if ((placement && !placement.deviceFromIndex) || (settings && !settings.settings)) return null;
    if (!volume) return { fact: fact as NewFact };
    if (!volume.worldFromIndex) return { fact: { volume: null } };
    const known = ["uint8", "int16", "uint16"] as const;
    const type = known.find((name) => name === VoxelTypes[volume.voxelType]?.toLowerCase()) ?? "float32";
    return { fact: { volume: { ...volume, size: [volume.sizeX, volume.sizeY, volume.sizeZ], type } as Volume } };
  } catch {
    return null;
  }
}
