<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<qgis version="3.22.0" styleCategories="Symbology|Labeling|Fields|Forms|MapTips" labelsEnabled="0">
 <renderer-v2 type="categorizedSymbol" attr="state" symbollevels="0" forceraster="0" enableorderby="0">
  <categories>
   <category symbol="0" value="gone" label="Gone (under 20 %)" render="true" />
   <category symbol="1" value="unsure" label="Unsure (20 to 80 %)" render="true" />
   <category symbol="2" value="probably_stands" label="Probably stands (80 to 95 %)" render="true" />
   <category symbol="3" value="stands" label="Stands (95 % and more)" render="true" />
   <category symbol="4" value="not_passed" label="No drive has passed" render="true" />
  </categories>
  <symbols>
   <symbol type="marker" name="0" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleMarker" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="name" type="QString" value="circle" />
      <Option name="color" type="QString" value="213,94,0,255" />
      <Option name="size" type="QString" value="3.2" />
      <Option name="size_unit" type="QString" value="MM" />
      <Option name="outline_color" type="QString" value="27,42,65,255" />
      <Option name="outline_width" type="QString" value="0.25" />
      <Option name="outline_width_unit" type="QString" value="MM" />
      <Option name="joinstyle" type="QString" value="miter" />
     </Option>
     <prop k="name" v="circle" />
     <prop k="color" v="213,94,0,255" />
     <prop k="size" v="3.2" />
     <prop k="size_unit" v="MM" />
     <prop k="outline_color" v="27,42,65,255" />
     <prop k="outline_width" v="0.25" />
     <prop k="outline_width_unit" v="MM" />
     <prop k="joinstyle" v="miter" />
    </layer>
   </symbol>
   <symbol type="marker" name="1" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleMarker" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="name" type="QString" value="circle" />
      <Option name="color" type="QString" value="240,228,66,255" />
      <Option name="size" type="QString" value="3.2" />
      <Option name="size_unit" type="QString" value="MM" />
      <Option name="outline_color" type="QString" value="27,42,65,255" />
      <Option name="outline_width" type="QString" value="0.25" />
      <Option name="outline_width_unit" type="QString" value="MM" />
      <Option name="joinstyle" type="QString" value="miter" />
     </Option>
     <prop k="name" v="circle" />
     <prop k="color" v="240,228,66,255" />
     <prop k="size" v="3.2" />
     <prop k="size_unit" v="MM" />
     <prop k="outline_color" v="27,42,65,255" />
     <prop k="outline_width" v="0.25" />
     <prop k="outline_width_unit" v="MM" />
     <prop k="joinstyle" v="miter" />
    </layer>
   </symbol>
   <symbol type="marker" name="2" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleMarker" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="name" type="QString" value="circle" />
      <Option name="color" type="QString" value="86,180,233,255" />
      <Option name="size" type="QString" value="2.6" />
      <Option name="size_unit" type="QString" value="MM" />
      <Option name="outline_color" type="QString" value="27,42,65,255" />
      <Option name="outline_width" type="QString" value="0.25" />
      <Option name="outline_width_unit" type="QString" value="MM" />
      <Option name="joinstyle" type="QString" value="miter" />
     </Option>
     <prop k="name" v="circle" />
     <prop k="color" v="86,180,233,255" />
     <prop k="size" v="2.6" />
     <prop k="size_unit" v="MM" />
     <prop k="outline_color" v="27,42,65,255" />
     <prop k="outline_width" v="0.25" />
     <prop k="outline_width_unit" v="MM" />
     <prop k="joinstyle" v="miter" />
    </layer>
   </symbol>
   <symbol type="marker" name="3" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleMarker" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="name" type="QString" value="circle" />
      <Option name="color" type="QString" value="0,114,178,255" />
      <Option name="size" type="QString" value="2" />
      <Option name="size_unit" type="QString" value="MM" />
      <Option name="outline_color" type="QString" value="27,42,65,255" />
      <Option name="outline_width" type="QString" value="0.25" />
      <Option name="outline_width_unit" type="QString" value="MM" />
      <Option name="joinstyle" type="QString" value="miter" />
     </Option>
     <prop k="name" v="circle" />
     <prop k="color" v="0,114,178,255" />
     <prop k="size" v="2" />
     <prop k="size_unit" v="MM" />
     <prop k="outline_color" v="27,42,65,255" />
     <prop k="outline_width" v="0.25" />
     <prop k="outline_width_unit" v="MM" />
     <prop k="joinstyle" v="miter" />
    </layer>
   </symbol>
   <symbol type="marker" name="4" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleMarker" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="name" type="QString" value="circle" />
      <Option name="color" type="QString" value="255,255,255,255" />
      <Option name="size" type="QString" value="1.6" />
      <Option name="size_unit" type="QString" value="MM" />
      <Option name="outline_color" type="QString" value="27,42,65,255" />
      <Option name="outline_width" type="QString" value="0.25" />
      <Option name="outline_width_unit" type="QString" value="MM" />
      <Option name="joinstyle" type="QString" value="miter" />
     </Option>
     <prop k="name" v="circle" />
     <prop k="color" v="255,255,255,255" />
     <prop k="size" v="1.6" />
     <prop k="size_unit" v="MM" />
     <prop k="outline_color" v="27,42,65,255" />
     <prop k="outline_width" v="0.25" />
     <prop k="outline_width_unit" v="MM" />
     <prop k="joinstyle" v="miter" />
    </layer>
   </symbol>
  </symbols>
 </renderer-v2>
 <fieldConfiguration />
 <aliases>
  <alias field="place_id" index="1" name="Sign" />
  <alias field="nvdb_type" index="2" name="NVDB object type" />
  <alias field="nvdb_id" index="3" name="NVDB id" />
  <alias field="skiltnummer" index="4" name="Sign codes" />
  <alias field="state" index="5" name="State" />
  <alias field="p_stands" index="6" name="Probability that it stands (0–1)" />
  <alias field="unsure_bits" index="7" name="How unsure (bit)" />
  <alias field="last_seen" index="8" name="Last seen (UTC)" />
  <alias field="last_passed" index="9" name="Last passed (UTC)" />
  <alias field="n_seen" index="10" name="Drives that saw it" />
  <alias field="n_missed" index="11" name="Drives that did not" />
  <alias field="verdict" index="12" name="Verdict" />
  <alias field="road" index="13" name="Road" />
  <alias field="kommune" index="14" name="Kommune" />
 </aliases>
 <editable>
  <field name="fid" editable="0" />
  <field name="place_id" editable="0" />
  <field name="nvdb_type" editable="0" />
  <field name="nvdb_id" editable="0" />
  <field name="skiltnummer" editable="0" />
  <field name="state" editable="0" />
  <field name="p_stands" editable="0" />
  <field name="unsure_bits" editable="0" />
  <field name="last_seen" editable="0" />
  <field name="last_passed" editable="0" />
  <field name="n_seen" editable="0" />
  <field name="n_missed" editable="0" />
  <field name="verdict" editable="0" />
  <field name="road" editable="0" />
  <field name="kommune" editable="0" />
 </editable>
 <previewExpression>"skiltnummer" || ' ' || "place_id"</previewExpression>
 <mapTip enabled="1">&lt;b&gt;[% coalesce(nullif(replace(replace("skiltnummer", '&amp;', '&amp;amp;'), '&lt;', '&amp;lt;'), ''), '–') %]&lt;/b&gt; &amp;nbsp; [% coalesce(nullif(replace(replace("place_id", '&amp;', '&amp;amp;'), '&lt;', '&amp;lt;'), ''), '–') %]
&lt;br&gt;stands with [% coalesce(to_string(round(100 * "p_stands", 1)) || ' %', '–') %], verdict [% coalesce(nullif(replace(replace("verdict", '&amp;', '&amp;amp;'), '&lt;', '&amp;lt;'), ''), '–') %]
&lt;br&gt;last seen [% coalesce(format_date("last_seen", 'yyyy-MM-dd'), '–') %], last passed [% coalesce(format_date("last_passed", 'yyyy-MM-dd'), '–') %] by drives that say something of it
&lt;br&gt;[% coalesce(to_string(round("n_seen", 0)) || '', '–') %] drives saw it, [% coalesce(to_string(round("n_missed", 0)) || '', '–') %] did not
&lt;br&gt;&lt;small&gt;[% coalesce(nullif(replace(replace("road", '&amp;', '&amp;amp;'), '&lt;', '&amp;lt;'), ''), '–') %]&lt;/small&gt;</mapTip>
</qgis>
