// The model of the link: a preset, or values of one's own, for what is transmitted from now on.

import { useEffect, useState } from "react";

import { api, sentenceOf } from "../../api/client";
import type { LinkChange, LinkConfig, LinkPreset } from "../../api/types";
import {
  configOf,
  type Direction,
  DIRECTIONS,
  draftOf,
  isUsable,
  LINK_FIELDS,
  type LinkDraft,
  presetOf,
  usableDraft,
} from "../../lib/linkModel";
import { formatSpan } from "../../lib/time";
import { Segments } from "../../ui/Segments";
import { useLinkChange } from "./useLinkChange";

const SHORT: Record<string, string> = {
  lab: "Lab",
  moon: "Moon",
  moon_relay: "Moon, relay",
  mars: "Mars",
};

export function LinkForm({ config }: { config: LinkConfig }) {
  const presets = usePresets();
  // What is being filled in, and on what it is based; nothing until something is changed.
  const [draft, setDraft] = useState<{ base: LinkChange; values: LinkDraft } | null>(null);
  const { set, failure, busy, blocked } = useLinkChange();
  const values = draft?.values ?? draftOf(config);
  const next = draft && configOf(draft.base, draft.values);
  const chosen = presetOf(next ?? config, presets.list);
  const about = presets.list.find((preset) => preset.name === chosen)?.title;
  const good = usableDraft(values);
  const fill = (direction: Direction, field: keyof LinkDraft["up"], text: string) =>
    setDraft({
      base: draft?.base ?? config,
      values: { ...values, [direction]: { ...values[direction], [field]: text } },
    });
  return (
    <form
      className="section stack"
      onSubmit={(event) => {
        event.preventDefault();
        if (next) void set(next).then((done) => done && setDraft(null));
      }}
    >
      {presets.list.length > 0 && (
        <Segments
          name="link-preset"
          label="Preset of the link"
          choices={presets.list.map(({ name, title }) => [name, SHORT[name] ?? name, title])}
          value={chosen ?? ""}
          set={(name) => {
            const base = presets.list.find((preset) => preset.name === name)?.config;
            if (base) setDraft({ base, values: draftOf(base) });
          }}
          testId="preset"
          inline
        />
      )}
      <p className="quiet small" data-testid="preset-about">
        {presets.failure ?? about ?? "values of your own"}
      </p>
      <table className="link-form">
        <thead>
          <tr>
            <th />
            <th scope="col">up</th>
            <th scope="col">down</th>
          </tr>
        </thead>
        <tbody>
          {LINK_FIELDS.map(([field, label, unit]) => (
            <tr key={field}>
              <th scope="row">
                {label} <span className="quiet">({unit})</span>
              </th>
              {DIRECTIONS.map((direction) => (
                <td key={direction} className="field">
                  <input
                    type="number"
                    className="num"
                    step="any"
                    min={0}
                    placeholder={field === "rate" ? "no limit" : undefined}
                    aria-label={`${label} ${direction} (${unit})`}
                    aria-invalid={!isUsable(field, values[direction][field])}
                    data-testid={`${field}-${direction}`}
                    value={values[direction][field]}
                    onChange={(event) => fill(direction, field, event.target.value)}
                  />
                </td>
              ))}
            </tr>
          ))}
        </tbody>
      </table>
      {failure && (
        <p className="trouble small" role="alert">
          {failure}
        </p>
      )}
      <div className="row between">
        <span className="quiet small">
          first word after{" "}
          <span className="num">
            {good ? formatSpan(Number(values.up.delay) + Number(values.down.delay)) : "–"}
          </span>
        </span>
        <span className="row">
          {draft && (
            <button type="button" className="button bare" onClick={() => setDraft(null)}>
              As it is
            </button>
          )}
          <button
            type="submit"
            className={draft ? "button primary" : "button"}
            data-testid="delay-apply"
            disabled={!good || !draft || busy || blocked}
            title={blocked ? "Only with the live rover" : "For what is transmitted from now on"}
          >
            Set link
          </button>
        </span>
      </div>
    </form>
  );
}

function usePresets(): { list: LinkPreset[]; failure: string | null } {
  const [list, setList] = useState<LinkPreset[]>([]);
  const [failure, setFailure] = useState<string | null>(null);
  useEffect(() => {
    let gone = false;
    api.linkPresets().then(
      (presets) => !gone && setList(presets),
      (error: unknown) => !gone && setFailure(`No presets: ${sentenceOf(error)}`),
    );
    return () => {
      gone = true;
    };
  }, []);
  return { list, failure };
}
